"""RRD, which Rerun's viewer opens: an entity for each command and signal."""

from pathlib import Path

import numpy as np

from ..extras import import_extra
from ..recording import Recording
from ..recording.table import list_columns

_TIMELINE = "time"  # of an episode, so that episodes lie over one another


def write_rrd(path: Path, recording: Recording, predicted: Recording | None) -> None:
    """Write an RRD, with entities such as `000/signals/knee_position`.

    Raises:
        InputError: the library is not installed.
    """
    rr = import_extra("rerun", "rerun", "RRD")
    stream = rr.RecordingStream("selfheal")
    stream.save(path)
    for episode in recording.episodes:
        time = recording.episodes[episode].time
        columns = list_columns(recording, predicted, episode)
        for name, (values, unit) in columns.items():
            entity = rr.new_entity_path([episode, *name.split("/", 1)])
            label = f"{name} [{unit}]" if unit else name
            rr.log(entity, rr.SeriesLines(names=label), static=True, recording=stream)
            read = np.isfinite(values)
            rr.send_columns(
                entity,
                indexes=[rr.TimeColumn(_TIMELINE, duration=time[read])],
                columns=rr.Scalars.columns(scalars=values[read]),
                recording=stream,
            )
    stream.flush()
    stream.disconnect()
