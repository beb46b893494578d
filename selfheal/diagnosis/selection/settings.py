"""Every threshold of the choice of effects, each with its unit and its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SelectionSettings:
    """Thresholds and budgets of the search for effects and of its tests.

    "Error" is a held-out squared error in standard deviations of the residuals. A
    "ratio" of errors is the new one over the old one. "Chosen" marks what no source
    and no benchmark prescribes; the reason follows.
    """

    # Budgets: how much is simulated

    screening_steps: tuple[int, ...] = (1500, 4000, 10000)
    """[simulation steps] of one trial in each round of the screening. Chosen: the
    screening of one joint's candidates takes about a minute."""

    screening_scored: int = 40
    """Candidates that are fitted after all were scored. Chosen: three times as many as
    the first round keeps."""

    screening_iterations: tuple[int, ...] = (1, 3, 2)
    """Gauss-Newton iterations of one trial in each round of the screening. Chosen: the
    first round only ranks."""

    screening_kept: tuple[int, ...] = (12, 5, 5)
    """Candidates that each round of the screening keeps (successive halving, Jamieson
    and Talwalkar 2016). Chosen with `screening_steps`."""

    search_jacobian_steps: float = 3e5
    """[simulation steps] of all columns of one Jacobian in a search, about. Chosen: a
    quadruped (70 nominal parameters) is searched in 24 segments then, in 400 s of
    CPU."""

    refit_steps: int = 40_000
    """[simulation steps] of one rollout of all segments in the last fit, at most.
    Chosen: about a minute at a time step of 1 ms."""

    refit_jacobian_steps: float = 1e6
    """[simulation steps] of all columns of one Jacobian in the last fit. Chosen: no
    longer fit for a robot with many nominal parameters."""

    min_more_steps: float = 1.3
    """Times the steps of the search from which on the last fit has segments of its own.
    Chosen: fewer add next to nothing to what the search's tell."""

    native_fit_steps: int = 15_000
    """[simulation steps] of the segments in the fit to the model's own time step.
    Chosen: only nominal values move there, so part of the segments is enough."""

    remaining_steps: int = 15_000
    """[simulation steps] of the segments in which unmodeled structure is looked for.
    Chosen: as `native_fit_steps`."""

    nearly_all_segments: float = 0.8
    """Share of the segments from which on all are taken. Chosen: a smaller subset would
    save less than a fifth."""

    min_search_segments: int = 24
    """Segments of a search, at least, if they are short: as many as the
    cross-validation has blocks."""

    min_search_seconds: float = 16.0
    """[s] of motion in a search, at least, of long segments (`long_screening_segment`).
    Chosen: 8 of 2 s have as many steps as 32 of half a second."""

    min_screening_segments: int = 4
    """Segments of a trial, at least, and of a search in long segments. Chosen: two with
    large residuals, two others."""

    min_first_screening_segments: int = 2
    """Segments of a trial in the first round, at least, if they are long. Chosen:
    development cases gave the same findings as with four."""

    long_screening_segment: float = 1.0
    """[s] from which on a segment is long. Chosen: between the two horizons, 0.5 and
    2 s."""

    # Screening: which candidates are fitted in full

    min_screening_gain: float = 0.005
    """Share of the cost that a candidate must remove to pass a round after the first.
    Chosen: a quarter of what a name must remove in the end."""

    max_retried_candidates: int = 100
    """Candidates that are tried again once another one has a name. Chosen: a robot with
    many unmeasured joints has hundreds."""

    max_finalists: int = 5
    """Candidates fitted together with all other values. Chosen: as the last number of
    `screening_kept`."""

    max_parameterless: int = 2
    """Candidates without a parameter, such as a lost limb, that are fitted. Chosen:
    each begins with a search of all initial states."""

    # Cross-validation

    min_simulated_folds: int = 4
    """Folds that are simulated, at least. Chosen: those that change most."""

    max_linear_error: float = 1e-3
    """Error of a fold's squared residuals if predicted linearly, of those of all folds,
    up to which the other folds are. Chosen: a twentieth of what a name must remove."""

    min_episodes: int = 3
    """Episodes from which on each is also predicted from the others. Chosen: of two
    each would be predicted from one."""

    single_reading_folds: int = 6
    """Folds of single readings, each predicted by a fit of its own. Chosen: each costs
    a fit of each candidate."""

    max_equivalent_error_ratio: float = 1.5
    """Ratio of errors above which a fit is not as good as another, however much the
    blocks disagree. Chosen: half as much again."""

    # Tests of one effect

    max_p_value: float = 0.01
    """p-value, corrected for the number of candidates, below which an effect earns its
    name. Chosen: a fifth of the 5 % of false names that nulls may have."""

    clear_p_value: float = 1e-6
    """p-value by a linearized fit below which no other fit is made. Chosen: a factor of
    ten thousand is what linearizing may be wrong by."""

    min_gain_standard_errors: float = 1.0
    """[standard errors over the blocks] that a gain must exceed. Chosen: one, as in the
    one-standard-error rule (Breiman et al. 1984)."""

    certain_nats: float = 5.0
    """[nats] above which one of two effects is surely likelier. Chosen on development
    single 149: a spring and a sensor's zero lay 26 nats apart, but only 1.9 standard
    errors over the blocks."""

    certain_error_excess: float = 0.02
    """Excess over 1 of the ratio of errors that goes with `certain_nats`. Chosen: as
    `removal_tolerance`."""

    equivalence_margin: float = 2.0
    """[standard errors or nats] within which two candidates are not told apart. Chosen:
    two standard errors, as usual; two nats are odds of seven to one."""

    min_standard_errors: float = 2.5
    """Standard errors from nominal that some value of a name must be. Chosen: chance
    alone does so once in eighty times, and other tests have been passed."""

    exchange_margin: float = 1.0
    """[standard errors or nats] within which a simpler hypothesis takes the place of
    another. Chosen: one, as in the one-standard-error rule (Breiman et al. 1984)."""

    student_degrees_of_freedom: float = 4.0
    """Degrees of freedom of Student's t distribution of single readings' errors (Lange,
    Little and Taylor 1989)."""

    student_min_scale: float = 0.1
    """Least scale of Student's t distribution, of the root mean square residual.
    Chosen: it keeps the scale from zero where most readings are fitted exactly."""

    student_iterations: int = 100
    """Iterations of the scale of Student's t distribution. Chosen: more than enough."""

    bootstrap_resamples: int = 400
    """Resamples of the blocks. Chosen: the standard error of a share is at most
    2.5 %."""

    # Choice among effects

    large_gain_error_ratio: float = 0.5
    """Ratio of errors that a rare effect, or one that contradicts the model, must reach
    where much stays unexplained. Chosen: it refuses a cogging of 5.6 poles that was
    once named for an XL330 at another voltage."""

    significant_prior_penalty: float = 12.0
    """[variances] by which nominal values must be off before that speaks for an effect.
    Chosen: a value at its bound counts 4, and in singles 78 and 84 five and four were
    there."""

    max_rivals: int = 3
    """Effects listed as equivalent to a name (contract, section 2: at most three)."""

    removal_tolerance: float = 0.02
    """Share by which the error may grow where an effect is removed. Chosen: as much as
    a name must remove where nothing touches (`Regime.min_gain`)."""

    reweightings_of_all: int = 2
    """Fits of all usual effects with weights set anew. Chosen: errors fall by a hundred
    in the first, and hardly in a third."""

    max_horizon_growth: float = 3.0
    """Ratio of errors over noise in longer segments to that in those of the search,
    above which the longer ones are not fitted. Chosen: errors that grow with time alone
    do so by about the ratio of lengths, four, and then hide what the shorter tell."""

    max_uncertain_removal: float = 0.3
    """Growth of the cost without an effect, or with another one in its place, above
    which a closer fit would not change the answer. Chosen: fifteen times
    `removal_tolerance`."""

    clear_removal_error_ratio: float = 2.0
    """Cost without an effect over that with it, to first order and simulated there,
    above which no closer fit is made. Chosen: far above `max_uncertain_removal`."""

    min_score_gain: float = 0.5
    """Share of the gain that an exchange needs, which a score test has to promise.
    Chosen: half, for the test is linear."""

    exchange_error_ratio: float = 0.97
    """Ratio of errors below which another hypothesis is better. Chosen: a gain of 3 %,
    more than `removal_tolerance`."""

    max_exchange_trials: int = 2
    """Alternatives to a name that are fitted in full. Chosen: each is one more fit of
    all values."""

    max_removal_trials: int = 3
    """Names that are tried without, the least costly ones. Chosen: each is a fit of all
    other values."""

    # Where the search ends

    max_effects: int = 6
    """Effects named together, and rounds of a search, at most. Chosen: each costs a
    screening of all candidates."""

    white_share: float = 0.6
    """Effective sample size of the residuals, of their number, from which on they count
    as white noise. Chosen below one, for estimated correlation times exceed one
    sample."""

    quiet_noise_ratio: float = 1.1
    """Residual over noise below which no effect is looked for beside a named one.
    Chosen. It does not hold before the first name: single 5544, a servo's gain, left
    1.01."""

    bound_margin: float = 1e-3
    """Share of a nominal value's range within which it is at its bound. Chosen: a fit
    that ends at a bound ends there exactly."""

    contact_remaining_share: float = 0.1
    """Share of the error that a robot with contact may keep when a search ends. Chosen:
    its cost is rough, and a quadruped's second search had not ended after 700 s."""

    # Change point

    min_explained_episodes: int = 1
    """Episodes that the nominal model must explain before a change point. Chosen: that
    a later one is explained as well from the start is tested."""

    min_explained_share: float = 0.25
    """Share of a lone episode that the nominal model must explain before a change
    point. Chosen: enough segments to fit nominal values to."""

    max_change_point_cuts: int = 8
    """Numbers of explained segments that are tried. Chosen: each is one fit."""

    change_point_error_ratio: float = 2.5
    """Squared residuals of the median later segment over those of nearly all earlier
    ones, at a change point. Chosen: a root mean square 1.6 times as large."""

    change_point_quantile: float = 0.9
    """Quantile of the earlier segments that stands for nearly all. Chosen: a tenth of
    them may be odd."""

    min_changed_share: float = 0.05
    """Share of the later segments that are far worse, if there is a change point at
    all. Chosen: one episode of twenty."""

    change_point_interval_nats: float = 1.35
    """[nats] within which an onset is as likely: half of 2.71, the 90 % quantile of
    chi-square with one degree of freedom (profile likelihood, Wilks 1938)."""

    # Quantization

    quantization_tolerance: float = 0.05
    """Share of a step that readings may lie beside its multiples, as where the step is
    estimated (`data.episodes`)."""

    min_quantization_noise_share: float = 0.5
    """Share of a reading's noise variance that rounding must be. Chosen: most of it."""

    min_quantization_residual_share: float = 0.25
    """Share of a residual's variance that rounding must be. Chosen: much of it."""

    # What is handed over

    max_rounding_step: float = 0.2
    """[half intervals] largest step of a value's last digit. Chosen: rounding then
    moves it by a tenth of that at most."""

    max_rounding_cost: float = 0.001
    """Share by which the cost may grow where values are rounded. Chosen: a twentieth of
    `removal_tolerance`."""

    max_extra_digits: int = 6
    """Times that all values may get one more digit. Chosen: they have single precision
    then."""

    # Verdict

    max_free_forms: int = 3
    """Joints whose free-form torque is tested: those that a score test favors. Chosen:
    each test simulates all blocks."""

    remaining_p_value: float = 0.01
    """p-value of a free-form torque below which structure remains. Chosen: as
    `max_p_value`."""

    min_remaining_share: float = 0.05
    """Share of the error that a free-form torque must explain to be structure. Chosen:
    so flexible a torque always explains a little."""

    min_explained_error: float = 0.5
    """Share of the explainable error that names must explain where structure remains.
    Chosen: the larger part."""

    fully_explained_error: float = 0.9
    """Share of the explainable error from which on a mismatch counts as explained.
    Chosen: what is left then is small beside what was found."""

    max_floor_ratio_of_nothing: float = 1.3
    """Held-out replay error over the floor, at any horizon, above which something is
    missing. Chosen: as `Regime.explained_ratio`."""

    min_removed_error: float = 0.1
    """Share of the explainable held-out error that names must remove. Chosen after null
    5202, where a false friction of 0.003 removed 6 %."""

    min_explainable_error: float = 0.05
    """Share of a held-out error below which nothing can be explained (contract, section
    2)."""

    worse_replay_ratio: float = 1.05
    """Held-out replay error over that of the refitted model above which names make it
    worse. Chosen: a tolerance of 5 %."""

    max_replay_floor_ratio: float = 6.0
    """Held-out replay error over the noise floor above which it is not all explained.
    Chosen: crossed springs, once told as nothing, left eight times the floor."""


SELECTION = SelectionSettings()
