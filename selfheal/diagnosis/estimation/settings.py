"""Every number of the fits, each with its unit and its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FitSettings:
    """Numbers of the least squares, of the noise model and of the standard errors.

    Residuals are in standard deviations, so that a cost, a sum of their squares, has no
    unit. A parameter's "scale" is the change that its effect declares as usual.
    "Chosen" marks what no source and no benchmark prescribes; the reason follows. What
    depends on the kind of data is in the table of `regime`.
    """

    # -- Residuals

    # [standard deviations] at which a residual is clipped, and what a diverged sample
    # counts. Chosen: far beyond any residual that tells of a parameter.
    max_residual: float = 300.0
    # Least standard deviation of a residual, of its signal's standard deviation.
    # Chosen: it only keeps quotients finite where a model is exact.
    min_residual_std_share: float = 1e-9
    # Blocks of neighboring segments, each predicted from the others, at most. Chosen:
    # enough to estimate a standard error, and each costs a simulation.
    max_blocks: int = 24

    # -- Prior of the nominal values

    # [standard deviations] between the bounds of a nominal value. Chosen: a value at
    # its bound, which the contract grants, is off by two.
    prior_stds_in_range: float = 4.0
    # [1] least range of a nominal value. Chosen: it only keeps quotients finite.
    min_prior_range: float = 1e-9

    # -- Step of a Gauss-Newton iteration

    # Cost of a step of one scale. Chosen: what no reading shows stays where it is, and
    # it is nothing against a thousand readings.
    step_penalty: float = 0.01
    # [1] share of each diagonal element, and of the largest one, added to a curvature.
    # Chosen: it keeps the curvature regular where columns are collinear.
    solver_damping: float = 1e-9
    # Least scaled curvature that `solver_damping` takes its share of. Chosen: it only
    # matters where no reading shows anything.
    min_curvature: float = 1e-12

    # -- Gauss-Newton iterations of a fit

    # Iterations of a fit, at most. Chosen: a fit that saves little ends sooner.
    iterations: int = 8
    # Share of the cost that an iteration must save for another one. Chosen: a twentieth
    # of what a name must remove.
    min_iteration_gain: float = 1e-3
    # Shares of the diagonal of the curvature that damp a step (Marquardt 1963). The
    # first one is tried alone. Chosen: from a full step to one of a thirtieth.
    dampings: tuple[float, ...] = (1e-4, 1e-2, 1.0, 30.0)
    # Fall of the cost over the fall that the quadratic model predicts, above which the
    # other dampings are not tried. Chosen: the customary bound of a good step (Nocedal
    # and Wright 2006, algorithm 4.1).
    min_gain_ratio: float = 0.75
    # Share of the cost below which a step is so short that Broyden's update is good
    # enough. Chosen: as much as a name must remove.
    broyden_gain: float = 0.02
    # Squared error of the linear prediction over the squared residuals, below which
    # Broyden's update is good enough. Chosen: the prediction is then right to a tenth
    # of a residual.
    broyden_error: float = 0.01
    # Squared error of the linear prediction over the fall of the cost, below which the
    # next step is taken with an updated Jacobian. Chosen: at this rate each such step
    # removes nine tenths of what is left to gain, and costs one simulation.
    secant_error: float = 0.1

    # -- Undamped refinement

    # Undamped steps, at most. Chosen: each costs a fine Jacobian.
    undamped_iterations: int = 3
    # [scales] over which a Jacobian of standard errors is differenced. Chosen: readings
    # hardly bend over it.
    fine_difference_step: float = 1e-4
    # Change of the residuals of other kinematic trees, of that of the own one, up to
    # which values of several trees are differenced together. Chosen: far below the
    # share by which a Jacobian of differences is wrong.
    max_tree_coupling: float = 1e-6
    # Change of the residuals by a difference over the residuals, above which it is
    # repeated over a smaller step. Chosen: a step of the fit changes them by as much as
    # they are, and its slope should be right to a tenth.
    max_difference: float = 0.1
    # Least share of a step that it is made smaller to. Chosen: a smaller one is near
    # the solver's own tolerance.
    min_difference_step_share: float = 0.02
    # Share of a value that counts as its scale in differences, if larger. Chosen: a
    # value a thousand scales large would drown in rounding, and one of 100 or less is
    # differenced by its scale.
    min_difference_share: float = 0.01
    # Residuals that are differenced at once, of all values: 80 MB. Chosen: beside a
    # Jacobian of many joints it is little, and fills all cores.
    max_difference_numbers: float = 1e7
    # Fall of the cost that the quadratic model must predict for another undamped step.
    # Chosen: values then move by a fifth of a standard error.
    undamped_min_gain: float = 0.05

    # -- Initial states

    # Least standard deviation of an initial state. Chosen: without noise no initial
    # state moves, and quotients stay finite.
    min_initial_state_std: float = 1e-300
    # Segments that a longer horizon leaves, at least. Chosen: as few as tell a mean
    # from its scatter.
    min_long_segments: int = 5
    # Segments in which is measured what errors of the initial states cause. Chosen: a
    # mean over so many is steady.
    state_response_segments: int = 24
    # Draws of the errors of many initial states, from which the size of what these
    # cause is estimated. Chosen: right to a tenth over a dozen segments.
    state_draws: int = 8
    # [standard deviations of a signal] that errors of the initial states may cause in a
    # horizon that still informs. Chosen: a tenth of what the signal tells.
    max_state_response: float = 0.1
    # Times what they cause in a shorter horizon, likewise. Chosen: a response that
    # grows faster has become nonlinear.
    max_state_response_growth: float = 2.0
    # Shares of a step of the initial states that are tried at once. Chosen: a line
    # search in one batch of simulations.
    state_step_shares: tuple[float, ...] = (1.0, 0.5, 0.2)
    # Share of a segment's cost that a step of its initial state must save, for another
    # linearization there. Chosen: of robots in contact a tenth to a third fewer
    # simulations lead to the same cost within 1 %.
    min_state_step_gain: float = 0.05
    # Squared error of a segment's linear prediction over the mean cost of a segment,
    # above which initial states do not act linearly. Chosen: as `broyden_error`.
    state_nonlinearity: float = 0.01
    # Times the median mean squared residual of the segments, above which a segment is
    # an outlier. Chosen: twice the root mean square.
    outlier_ratio: float = 4.0
    # [standard deviations] by which an outlier's initial velocities are tried above and
    # below those read. Chosen: readings hold 95 % within.
    velocity_offset: float = 2.0
    # [standard deviations] of an initial state from what was read, above which it is
    # searched from there again. Chosen: beyond the 99.7 % of an error.
    max_state_offset: float = 3.0
    # Share of the cost that the other segments would save without one, above which its
    # initial state may mislead; and that a new one must save. Chosen: half of what a
    # name must remove where nothing touches.
    misleading_cost_share: float = 0.01
    # Iterations of the fit with such an initial state estimated again. Chosen: it
    # begins near its end.
    misleading_iterations: int = 3

    # -- Contact: fits over a rough cost

    # [standard deviations] of initial states, of the perturbations over which rough
    # residuals are averaged. Chosen: it changes nothing but which roughness is met.
    antithetic_offset: float = 0.1
    # Multiples of a value at which better minima are looked for. Chosen: from half of
    # it to double.
    far_multiples: tuple[float, ...] = (0.5, 0.7, 0.85, 1.2, 1.4, 2.0)
    # Multiples of a value along a valley. Chosen: so near that all other values answer
    # linearly.
    near_multiples: tuple[float, ...] = (0.9, 0.95, 1.05, 1.1)
    # Iterations of a smoothed fit, at most. Chosen: as `iterations`.
    smoothed_iterations: int = 8
    # Perturbations over which residuals are averaged. Chosen: two pairs.
    smoothed_samples: int = 4
    # Perturbations where one iteration would take all of `smoothed_effort`. Chosen: one
    # pair.
    smoothed_samples_if_slow: int = 2
    # [simulation steps times degrees of freedom] of one such search. Chosen: about a
    # minute.
    smoothed_effort: float = 6e7
    # Shares of a smoothed step that are tried. Chosen: more than all of it, too, for
    # roughness makes slopes steeper.
    smoothed_step_shares: tuple[float, ...] = (2.0, 1.0, 0.5)

    # -- Noise model

    # [samples] lags of the variogram. Chosen: over so few samples what is left of a
    # motion drifts linearly.
    variogram_lags: tuple[int, ...] = (1, 2, 3, 4, 6, 8)
    # Least and largest AR(1) coefficient that is tried. Chosen: below, noise is white;
    # residuals that the largest one fits best are motion.
    ar1_range: tuple[float, float] = (0.1, 0.98)
    # AR(1) coefficients that are tried. Chosen: every 0.02.
    ar1_count: int = 45
    # Root mean square relative error of a variogram that fits. Chosen: within 3 %.
    max_variogram_error: float = 0.03
    # Variance of noise about a local polynomial over the one found there, above which
    # residuals are not that noise. Chosen: a tolerance of 30 %.
    max_short_noise_ratio: float = 1.3
    # Variance of autocorrelated noise over the one found about a local polynomial,
    # below which noise counts as white. Chosen: less changes no weight much.
    min_noise_excess: float = 1.2
    # Root mean square residual over the scatter about a local polynomial, below which
    # the scatter is not noise. Chosen: half its variance. Where commands jump, torques
    # do, and no polynomial follows.
    min_scatter_ratio: float = 0.7
    # Relative difference of noises that changes nothing. Chosen: weights then change by
    # less than a fifth.
    same_noise_tolerance: float = 0.1
    # Share of the noise that estimated initial states leave in residuals, at least.
    # Chosen: half, where states are about as many as readings.
    min_noise_share: float = 0.5
    # Least squared residuals that noise is said to leave. Chosen: it only keeps
    # quotients finite.
    min_expected_noise: float = 1e-12
    # Standard deviation over the median absolute value of a normal distribution, 1 /
    # Phi^-1(3/4) (Huber 1981, section 5.2).
    mad_to_std: float = 1.4826
    # Root mean square residual over noise, above which something is unexplained.
    # Chosen: double, for the noise is an estimate.
    unexplained_ratio: float = 2.0
    # The ratio above which something is unexplained beside names that may stand for
    # others. Chosen: stricter than `unexplained_ratio`, as several names, or a rare
    # one, fit more easily.
    strictly_unexplained_ratio: float = 1.3
    # Segments among which the worst one does not make a channel unexplained. Chosen: a
    # channel that is wrong is so throughout.
    segments_per_outlier: int = 10
    # Segments, but for one, among which that holds where they are few. Chosen: most of
    # them still count.
    min_segments_per_outlier: int = 3
    # Times the standard deviation of residuals of channels that are not scored. Chosen:
    # a fit is a compromise there.
    unscored_std_factor: float = 4.0

    # -- Standard errors

    # Samples of a series from which on its correlation time is estimated. Chosen: fewer
    # tell no correlation in time.
    min_correlated_samples: int = 4
    # Least denominator of a quotient. Chosen: near the smallest double, so that it only
    # replaces zero.
    tiny: float = 1e-300
    # Norm of a column of a Jacobian, of the largest one, below which a parameter is not
    # identifiable. Chosen: less is rounding of a simulation.
    min_column_share: float = 1e-9
    # Least eigenvalue of a curvature, of the largest one. Chosen: at the rounding of a
    # double; the prior alone may be that small beside many readings.
    min_eigenvalue_share: float = 1e-14
    # [standard errors] half a 90 % interval: the 95 % quantile of a normal
    # distribution.
    interval_standard_errors: float = 1.645
    # Times as wide is the interval of a finding, for models are wrong in ways that no
    # standard error counts. Measured: of 71 values that others hid, 1.645 standard
    # errors held 75 %, these 83 %.
    interval_factor: float = 1.4


FIT = FitSettings()
