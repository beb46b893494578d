"""Lengths stated after damage are counted against the true ones."""

from selfheal.study.plan import find_study


def test_lengths_stated_are_counted_against_true_ones():
    whole, short = [0.5, 1.5, 0.9, 1.0], [0.5, 1.5, 0.9, 0.1]
    outcome = {"success": True, "error": [0.1], "actions": [3], "evaluations": 1,
               "lengths": [whole, whole, whole, short]}  # fmt: skip
    settings = {"robot": "starfish", "phase": "after", "method": "ours"}
    record = {"settings": settings, "outcome": outcome, "seconds": 1.0}
    *_, table = find_study("table3").make_tables([record] * 5)
    (every, alone) = table.rows
    assert every[3].startswith("90.0 %") and every[4].startswith("15/20 = 75.0 %")
    assert alone[4].startswith("0/5") and (every[5], alone[5]) == ("0.2100", "0.8100")
