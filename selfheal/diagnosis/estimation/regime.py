"""Regimes: what the data of a problem allow a fit and a choice of models to ask."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Regime:
    """One row of the table below.

    Attributes:
        has_rough_cost: whether the robot makes and breaks contact. Impacts make the
            cost a rough function of the values, which drives each of them some way.
        has_single_readings: whether each episode was read once, as of a robot that
            takes poses. Nothing then tells the noise, or when something happened.
        difference_step: of a parameter's scale, over which a Jacobian is differenced.
            0.02 stays above the solver's noise. Readings of a motion with impacts jump
            at any change, and only over 0.3 does the slope tell more than the jump.
            Both chosen.
        min_gain: least share of the held-out squared error that a named effect
            removes; chosen.
        explained_ratio: residual over noise up to which a fit counts as explained;
            chosen.
        prior_penalty_of_value: [variances] by which impacts drive one nominal value;
            chosen.
    """

    has_rough_cost: bool
    has_single_readings: bool
    difference_step: float
    min_gain: float
    explained_ratio: float
    prior_penalty_of_value: float

    @property
    def is_nonsmooth(self) -> bool:
        """Whether impacts make trajectories jump as values or initial states change."""
        return self.has_rough_cost and not self.has_single_readings


SMOOTH = Regime(False, False, 0.02, 0.02, 1.3, 0.0)
CONTACT = Regime(True, False, 0.3, 0.1, 2.0, 1.0)
SINGLE_READINGS = Regime(False, True, 0.02, 0.02, 1.3, 0.0)
POSES_IN_CONTACT = Regime(True, True, 0.02, 0.02, 2.0, 1.0)


def find_regime(has_contact: bool, has_single_readings: bool) -> Regime:
    """The regime of a robot that touches something or not, and of how it was read."""
    if has_single_readings:
        return POSES_IN_CONTACT if has_contact else SINGLE_READINGS
    return CONTACT if has_contact else SMOOTH
