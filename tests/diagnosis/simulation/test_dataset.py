"""How recordings are parted in what is fitted and what is held out."""

import numpy as np
import pytest

from selfheal.diagnosis.simulation.dataset import (
    SHORT_SEGMENT,
    cut_readable_segments,
    prepare_dataset,
)
from tests.support.recorded_robots import ROBOTS, change_readings, record


@pytest.mark.parametrize("lost", [0, 1], ids=["where it is fitted", "held out"])
def test_columns_are_the_same_where_a_signal_is_not_read(lost, tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(ROBOTS["cart_pole"].xml)
    recording = record(ROBOTS["cart_pole"], episodes=2, seconds=0.3)
    unread = change_readings(
        recording,
        lambda values: values * np.nan,
        episodes=[list(recording.episodes)[lost]],
        signals=["cart"],
    )
    dataset = prepare_dataset(path, [unread], ["001"])
    fitted, held_out = (
        [(c.name, c.first_column) for c in s.channels]
        for s in (dataset.training, dataset.held_out)
    )
    cart = [("cart", 0)] if lost else []
    assert fitted == held_out == [*cart, ("pole", len(cart))]


def test_an_episode_stays_whole_whose_pieces_begin_where_nothing_was_read(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(ROBOTS["pendulum"].xml)
    recording = record(
        ROBOTS["pendulum"], episodes=2, seconds=2.01, rate=100, states=False
    )
    angle = recording.episodes["001"].signals["angle"].values
    to_cut = np.abs((np.arange(len(angle)) + 25) % 50 - 25)  # rows to the nearest one
    angle[to_cut < 11] = np.nan
    dataset = prepare_dataset(path, [recording], ["001"])
    segments = cut_readable_segments(dataset.held_out, SHORT_SEGMENT)
    assert len(segments) >= 1
