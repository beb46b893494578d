"""Held-out parts share no sample with what may be fitted, and lie apart from it."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.errors import InputError, RecordingError
from selfheal.recording import Episode, Recording, Signal, split, validate, write
from selfheal.recording.split import GAP


def _recording(*names: str, samples: int = 301) -> Recording:
    """Episodes of 3 s; the signal tells each sample from every other."""
    return Recording(
        {
            name: Episode(
                np.linspace(0, 3, samples),
                np.arange(samples, dtype=float)[:, None],
                ("motor",),
                {"s": Signal(np.arange(samples) + 1000.0 * i, "sensor", "s", "1")},
                qpos0=np.zeros(1),
                qvel0=np.zeros(1),
            )
            for i, name in enumerate(names)
        },
        file="/data/arm.h5",
    )


def _samples(recording: Recording) -> set[float]:
    episodes = recording.episodes.values()
    return {float(v) for e in episodes for v in e.signals["s"].values}


SPLITS = [
    (("a",), []),
    (("a", "b"), []),
    (("a", "b", "c", "d", "e", "f"), []),
    (("a", "b"), ["a"]),
    (("a", "b"), ["arm.h5:b"]),
    (("a", "b"), ["/data/arm.h5:b"]),
    (("a", "b"), ["a[1,2]"]),
    (("a", "b"), ["arm.h5:a[1.0,1.2]", "a[2,2.5]", "b"]),
    (("a",), ["a[0,1]"]),
    (("a", "a[1,2]"), ["a[1,2]"]),
]


@pytest.mark.parametrize(("names", "held_out"), SPLITS)
def test_the_parts_are_valid_and_share_nothing(names, held_out):
    recording = _recording(*names)
    fit, held = split(recording, held_out=held_out)
    for part in (fit, held):
        validate(part)
        assert _samples(part) <= _samples(recording)
    assert not _samples(fit) & _samples(held)


@pytest.mark.parametrize("held_out", [[], ["a[1,2]"], ["a[0,0.5]", "a[2,2.1]"]])
def test_a_gap_lies_between_the_parts_of_one_episode(held_out):
    fit, held = split(_recording("a"), held_out=held_out)
    times = [
        np.concatenate([e.time for e in part.episodes.values()]) for part in (fit, held)
    ]
    apart = np.abs(times[0][:, None] - times[1]).min()
    assert apart >= GAP * 3


def test_of_one_episode_the_last_third_is_held_out():
    fit, held = split(_recording("a"))
    (episode,) = held.episodes.values()
    assert episode.time[0] == pytest.approx(2)
    assert episode.time[-1] == 3
    (episode,) = fit.episodes.values()
    assert episode.time[0] == 0


def test_of_several_episodes_a_third_is_held_out_whole():
    recording = _recording("a", "b", "c", "d", "e", "f")
    fit, held = split(recording)
    assert len(held.episodes) == 2
    assert {**fit.episodes, **held.episodes} == dict(recording.episodes)


@pytest.mark.parametrize("fastest", [0, 1, 2, 3])
def test_what_is_held_out_lies_within_what_is_fitted(fastest):
    """Motions of several speeds, and one that is fastest: it is needed for the fit."""
    time = np.linspace(0, 3, 301)
    episodes = {}
    for i, rate in enumerate(np.roll([9.0, 1.0, 3.0, 4.0], fastest)):
        swing = Signal(np.sin(rate * time), "joint_position", "s", "rad")
        episodes[str(i)] = Episode(time, np.zeros((301, 0)), (), {"s": swing})
    _, held = split(Recording(episodes))
    # the fastest of those that another spans, but the first: it may show another robot
    third = (fastest + 3) % 4 or (fastest + 2) % 4
    assert list(held.episodes) == [str(third)]


def test_episodes_without_a_common_reading_can_be_parted():
    recording = _recording("a", "b", "c")
    episodes = dict(recording.episodes)
    lost = replace(episodes["b"].signals["s"], values=np.full(301, np.nan))
    episodes["b"] = replace(episodes["b"], signals={"s": lost})
    fit, held = split(replace(recording, episodes=episodes))
    assert len(fit.episodes) == 2
    assert len(held.episodes) == 1


@pytest.mark.parametrize("held_out", [["a", "b"], ["a[0,3]", "b[0,3]"]])
def test_something_must_be_left_to_fit(held_out):
    with pytest.raises(RecordingError, match="nothing is left"):
        split(_recording("a", "b"), held_out=held_out)


def test_only_a_segment_that_starts_with_its_episode_has_its_state():
    fit, held = split(_recording("a"), held_out=["a[1,2]"])
    first, last = fit.episodes.values()
    assert first.qpos0 is not None
    assert first.qvel0 is not None
    for piece in (last, *held.episodes.values()):
        assert piece.qpos0 is None
        assert piece.qvel0 is None


def test_a_held_out_segment_has_the_name_that_holds_it_out_again(tmp_path):
    recording = _recording("a", samples=97)
    _, held = split(recording)
    _, again = split(recording, held_out=[f"arm.h5:{name}" for name in held.episodes])
    assert list(again.episodes) == list(held.episodes)
    assert _samples(again) == _samples(held)
    write(again, tmp_path / "held_out.h5")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("z", "unknown episode of /data/arm.h5 'z'; valid: a, b"),
        ("other.h5:a", "unknown episode.*'other.h5:a'"),
        ("z[0,1]", "unknown episode"),
        ("a[0;1]", "unknown episode"),
        ("a[0,one]", "two times in s"),
        ("a[5,6]", "has no sample; the episode lasts from 0.0 to 3.0 s"),
        ("a[2,1]", "has no sample"),
        ("a[nan,1]", "has no sample"),
    ],
)
def test_a_name_that_holds_out_nothing_is_refused(entry, said):
    with pytest.raises(InputError, match=said):
        split(_recording("a", "b"), held_out=[entry])


def test_nothing_can_be_held_out_of_two_samples():
    recording = _recording("a", samples=2)
    with pytest.raises(RecordingError, match="third: 2; would fit: at least 3"):
        split(recording)


def test_the_parts_keep_where_they_are_from():
    recording = replace(_recording("a", "b"), robot="arm", source="made up")
    for part in split(recording):
        assert (part.robot, part.source) == ("arm", "made up")
