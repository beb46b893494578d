"""Regimes: takes contact and the way of reading, gives what fits may ask of data."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Regime:
    """One row of the table: what a fit may ask of one kind of data.

    All numbers are chosen, for the reasons below.

    Attributes:
        has_rough_cost: whether the robot makes and breaks contact. Impacts make the
            cost a rough function of the values, which moves each of them some way.
        has_single_readings: whether each episode was read once, as of a robot that
            takes poses. Nothing then tells the noise, or when something happened.
        difference_step: [scales of the parameters] over which a Jacobian is
            differenced. 0.02 stays above the solver's noise. Readings of a motion with
            impacts jump at any change, and only over 0.3 does the slope exceed the
            jump.
        explained_ratio: root mean square residual over noise up to which a fit counts
            as explained. More in contact, where no fit reaches the noise.
        estimates_noise: whether residuals are numerous enough to estimate the noise.
        min_relinearized_gain: share of the cost that steps with one Jacobian must have
            saved for another one where no step saves more. In contact a tenth: after
            less, its slopes are as rough.
        state_iterations: Gauss-Newton iterations of the initial states, at most. Single
            readings are linearized once.
        misleading_state_trials: segments whose initial states are estimated again
            because they mislead a fit, at most.
    """

    has_rough_cost: bool
    has_single_readings: bool
    difference_step: float
    explained_ratio: float
    estimates_noise: bool
    min_relinearized_gain: float
    state_iterations: int
    misleading_state_trials: int

    @property
    def is_nonsmooth(self) -> bool:
        """Whether impacts make trajectories jump as values or initial states change."""
        return self.has_rough_cost and not self.has_single_readings


SMOOTH = Regime(
    has_rough_cost=False,
    has_single_readings=False,
    difference_step=0.02,
    explained_ratio=1.3,
    estimates_noise=True,
    min_relinearized_gain=0.0,
    state_iterations=5,
    misleading_state_trials=2,
)
CONTACT = replace(
    SMOOTH,
    has_rough_cost=True,
    difference_step=0.3,
    explained_ratio=2.0,
    min_relinearized_gain=0.1,
)
SINGLE_READINGS = replace(
    SMOOTH,
    has_single_readings=True,
    estimates_noise=False,
    state_iterations=0,
    misleading_state_trials=0,
)
POSES_IN_CONTACT = replace(
    SINGLE_READINGS,
    has_rough_cost=True,
    explained_ratio=2.0,
)


def find_regime(has_contact: bool, has_single_readings: bool) -> Regime:
    """The regime of a robot that makes contact or not, read in motion or in poses."""
    if has_single_readings:
        return POSES_IN_CONTACT if has_contact else SINGLE_READINGS
    return CONTACT if has_contact else SMOOTH
