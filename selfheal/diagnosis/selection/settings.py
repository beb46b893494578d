"""Every threshold of the choice of effects, each with its unit and its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SelectionSettings:
    """Budgets and thresholds around the search for effects.

    A "ratio" of errors is the new one over the old one. "Chosen" marks what no source
    prescribes; the reason follows.
    """

    # -- Budgets: how much is simulated

    # [simulation steps] of one rollout of the segments of a search, at most. Chosen:
    # all candidates of one joint take about a minute then.
    search_steps: int = 10_000
    # [simulation steps] of all columns of one Jacobian in a search, about. Chosen: a
    # quadruped (70 nominal parameters) is searched in 24 segments then, in 400 s of
    # CPU.
    search_jacobian_steps: float = 3e5
    # [simulation steps] of one rollout of all segments in the last fit, at most.
    # Chosen: about a minute at a time step of 1 ms.
    refit_steps: int = 40_000
    # [simulation steps] of all columns of one Jacobian in the last fit. Chosen: no
    # longer fit for a robot with many nominal parameters.
    refit_jacobian_steps: float = 1e6
    # Times the steps of the search from which on the last fit has segments of its own.
    # Chosen: fewer add next to nothing to what the search's tell.
    min_more_steps: float = 1.3
    # [simulation steps] of the segments in the fit to the model's own time step.
    # Chosen: only nominal values move there, so part of the segments is enough.
    native_fit_steps: int = 15_000
    # [simulation steps] of the segments in which unmodeled structure is looked for.
    # Chosen: as `native_fit_steps`.
    remaining_steps: int = 15_000
    # Share of the segments from which on all are taken. Chosen: a smaller subset would
    # save less than a fifth.
    nearly_all_segments: float = 0.8
    # Segments of a search, at least, if they are short: as many as a cross-validation
    # has blocks.
    min_search_segments: int = 24
    # [s] of motion in a search, at least, of long segments (`long_segment`). Chosen: 8
    # of 2 s have as many steps as 32 of half a second.
    min_search_seconds: float = 16.0
    # Segments of a search in long segments, at least. Chosen: of fewer no scatter can
    # be had.
    min_long_segments: int = 4
    # [s] from which on a segment is long. Chosen: between the two horizons, 0.5 and 2
    # s.
    long_segment: float = 1.0
    # Standard errors from nominal that some value of a name must be. Chosen: chance
    # alone does so once in eighty times, and other tests have been passed.
    min_standard_errors: float = 2.5
    # [variances] by which nominal values must be off before that speaks for an effect.
    # Chosen: a value at its bound counts 4, and in singles 78 and 84 five and four were
    # there.
    significant_prior_penalty: float = 12.0
    # Fits of a set of effects with weights set anew. Chosen: errors fall by a hundred
    # in the first, and hardly in a third.
    reweightings_of_all: int = 2
    # Ratio of errors over noise in longer segments to that in those of the search,
    # above which the longer ones are not fitted. Chosen: errors that grow with time
    # alone do so by about the ratio of lengths, four, and then hide what the shorter
    # tell.
    max_horizon_growth: float = 3.0
    # Effective sample size of the residuals, of their number, from which on they count
    # as white noise. Chosen below one, for estimated correlation times exceed one
    # sample.
    white_share: float = 0.6
    # Share of a nominal value's range within which it is at its bound. Chosen: a fit
    # that ends at a bound ends there exactly.
    bound_margin: float = 1e-3

    # -- Change point

    # Episodes that the nominal model must explain before a change point. Chosen: that a
    # later one is explained as well from the start is tested.
    min_explained_episodes: int = 1
    # Share of a lone episode that the nominal model must explain before a change point.
    # Chosen: enough segments to fit nominal values to.
    min_explained_share: float = 0.25
    # Numbers of explained segments that are tried. Chosen: each is one fit.
    max_change_point_cuts: int = 8
    # Squared residuals of the median later segment over those of nearly all earlier
    # ones, at a change point. Chosen: a root mean square 1.6 times as large.
    change_point_error_ratio: float = 2.5
    # Quantile of the earlier segments that stands for nearly all. Chosen: a tenth of
    # them may be outliers.
    change_point_quantile: float = 0.9
    # Share of the later segments that are far worse, if there is a change point at all.
    # Chosen: one episode of twenty.
    min_changed_share: float = 0.05
    # [nats] within which an onset is as likely: half of 2.71, the 90 % quantile of chi-
    # square with one degree of freedom (profile likelihood, Wilks 1938).
    change_point_interval_nats: float = 1.35

    # -- Quantization

    # Share of a step that readings may lie beside its multiples, as where the step is
    # estimated (`data.episodes`).
    quantization_tolerance: float = 0.05
    # Share of a reading's noise variance that rounding must be. Chosen: most of it.
    min_quantization_noise_share: float = 0.5
    # Share of a residual's variance that rounding must be. Chosen: much of it.
    min_quantization_residual_share: float = 0.25

    # -- What is handed over

    # [half intervals] largest step of a value's last digit. Chosen: rounding then moves
    # it by a tenth of that at most.
    max_rounding_step: float = 0.2
    # Share by which the cost may grow where values are rounded. Chosen: a twentieth of
    # `removal_tolerance`.
    max_rounding_cost: float = 0.001
    # Times that all values may get one more digit. Chosen: they have single precision
    # then.
    max_extra_digits: int = 6

    # -- Verdict

    # Joints whose free-form torque is tested: those that a score test favors. Chosen:
    # each test simulates all blocks.
    max_free_forms: int = 3
    # Share of the error that a free-form torque must explain to be structure. Chosen:
    # so flexible a torque always explains a little.
    min_remaining_share: float = 0.05
    # Share of the explainable error that names must explain where structure remains.
    # Chosen: the larger part.
    min_explained_error: float = 0.5
    # Share of the explainable error from which on a mismatch counts as explained.
    # Chosen: what is left then is small beside what was found.
    fully_explained_error: float = 0.9
    # Held-out replay error over the floor, at any horizon, above which something is
    # missing. Chosen: as `Regime.explained_ratio`.
    max_floor_ratio_of_nothing: float = 1.3
    # Share of the explainable held-out error that names must remove. Chosen after null
    # 5202, where a false friction of 0.003 removed 6 %.
    min_removed_error: float = 0.1
    # Share of a held-out error below which nothing can be explained (contract, section
    # 2).
    min_explainable_error: float = 0.05
    # Held-out replay error over that of the refitted model above which names make it
    # worse. Chosen: a tolerance of 5 %.
    worse_replay_ratio: float = 1.05
    # Held-out replay error over the noise floor above which it is not all explained.
    # Chosen: crossed springs, once reported as nothing, left eight times the floor.
    max_replay_floor_ratio: float = 6.0


SELECTION = SelectionSettings()
