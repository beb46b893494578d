"""The time that a diagnosis takes is predicted from what its stages took so far."""

from types import SimpleNamespace

import pytest

from selfheal.diagnosis.selection.search_record import SearchRecord
from selfheal.diagnosis.selection.time_left import COSTS, Stage, TimeLeft


@pytest.fixture
def clock():
    return SimpleNamespace(seconds=0.0)


def _run(clock, scale: float, named: int, begun: float = 0.0) -> list[float]:
    """Shares as the stages of a diagnosis begin that takes what it should."""
    left = TimeLeft(begun, lambda: clock.seconds)
    shares = []
    took = {Stage.READ: 0.0, Stage.NOMINAL: 0.25, Stage.DERIVATIVES: 0.75}
    took |= {stage: fixed + more * named for stage, (fixed, more) in COSTS.items()}
    left.named = named
    for stage, units in took.items():
        shares.append(left.enter(stage))
        clock.seconds += scale * units
    return [*shares, left.enter(Stage.TESTS)]


@pytest.mark.parametrize("named", [1, 5])
def test_a_diagnosis_that_takes_what_it_should_is_predicted_on_any_machine(
    named, clock
):
    begun, shares = {}, {}
    for scale in (0.1, 30.0):
        begun[scale] = clock.seconds
        shares[scale] = _run(clock, scale, named, clock.seconds)
        whole = clock.seconds - begun[scale]
        over = whole - scale * sum(a + b * named for a, b in COSTS.values())
        assert shares[scale][:2] == [0.0, 0.0]  # nothing is known yet
        assert shares[scale][3] == pytest.approx(over / whole)
    assert shares[0.1] == pytest.approx(shares[30.0])


def test_shares_never_fall_though_more_is_found(clock):
    left = TimeLeft(None, lambda: clock.seconds)
    shares = []
    stages = [Stage.READ, Stage.NOMINAL, Stage.DERIVATIVES, Stage.SEARCH, Stage.FITS]
    for named, stage in enumerate([*stages, Stage.DERIVATIVES, *stages[3:] * 3]):
        left.named = 3 * named
        shares.append(left.enter(stage))
        clock.seconds += 2.0
    assert shares == sorted(shares) and 0 < shares[-1] < 1


def test_a_record_tells_the_share_with_what_is_done(clock):
    told = []
    record = SearchRecord(
        lambda what, share: told.append((what, share)),
        TimeLeft(None, lambda: clock.seconds),
    )
    for stage in (Stage.READ, Stage.NOMINAL, Stage.DERIVATIVES):
        record.enter(stage, stage.name)
        clock.seconds += 1.0
    record("trying this", 1)
    assert [what for what, _ in told] == [
        "READ",
        "NOMINAL",
        "DERIVATIVES",
        "trying this",
    ]
    assert told[0][1] == 0 and 0 < told[2][1] < told[3][1] < 1
