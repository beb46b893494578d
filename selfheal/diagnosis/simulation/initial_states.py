"""Initial states of a batch: takes hypotheses and segments, gives where each begins."""

from dataclasses import dataclass

import mujoco
import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..effects.places import AddedJointPlace, SecondJointPlace
from ..effects.protocols import JointAddition
from .actuator_states import (
    compute_activations,
    fill_histories,
    integrate_servo_errors,
)
from .batch import BatchState, Hypotheses
from .system import RecordedSystem


@dataclass(frozen=True, eq=False)
class InitialStates:
    """Computes the initial states of n hypotheses in W segments, N = n W simulations.

    Positions and velocities are those that the readings say, each corrected for what a
    hypothesis says of its sensor. What no sensor reads (filters, delays, integrals,
    added joints) follows from the past commands or from the load at the beginning.
    """

    system: RecordedSystem
    hypotheses: Hypotheses
    segments: Segments

    def compute(self, initial_state_offset: Floats | None) -> BatchState:
        """Initial states of the N simulations, all segments of a hypothesis in a row.

        `initial_state_offset`: (n, W, 2 nv) added to positions and then velocities in
        the given model's degrees of freedom [rad or m, and per s]; None: nothing.
        """
        system, hypotheses, segments = self.system, self.hypotheses, self.segments
        variant = hypotheses.variant
        n, w = len(hypotheses.models), len(segments)
        qpos, qvel = self._nominal_states(n)
        if initial_state_offset is not None:
            given = system.compiler.nominal
            if given.neq:
                initial_state_offset = self._follow_loops(initial_state_offset)
            qpos, qvel = _add_offset(given, qpos, qvel, initial_state_offset)
        q, v = np.zeros((n, w, variant.model.nq)), np.zeros((n, w, variant.model.nv))
        q[:] = variant.model.qpos0
        q[..., variant.qpos], v[..., variant.dof] = qpos, qvel
        for term, values in zip(hypotheses.terms, hypotheses.term_values, strict=True):
            if isinstance(term.effect, JointAddition):
                for place in variant.list_added_joints([term]):
                    self._settle_added_joint(term.effect, place, values, q, v)
        histories = fill_histories(system, variant.model, segments)
        return BatchState(
            q.reshape(n * w, -1),
            v.reshape(n * w, -1),
            compute_activations(system, hypotheses, segments),
            integrate_servo_errors(system, hypotheses, segments),
            None if histories is None else np.tile(histories, (n, 1)),
        )

    def _nominal_states(self, n: int) -> tuple[Floats, Floats]:
        """Positions (n, W, nq) and velocities (n, W, nv) in the given model."""
        given = self.system.compiler.nominal
        if self.hypotheses.reading_changes:
            qpos, qvel = self._estimate_states(n)
        else:
            qpos, qvel = self.system.cache.load_or_compute(
                self.segments, "initial states", lambda: self._estimate_states(1)
            )
        shape = (n, len(self.segments))
        return (
            np.broadcast_to(qpos, (*shape, given.nq)).copy(),
            np.broadcast_to(qvel, (*shape, given.nv)).copy(),
        )

    def _estimate_states(self, n: int) -> tuple[Floats, Floats]:
        """Positions (n, W, nq) and velocities (n, W, nv) as each hypothesis reads."""
        system, segments = self.system, self.segments
        given = system.compiler.nominal
        of_all = self.hypotheses.reading_changes
        changes = [
            {
                name: {k: v[i].tolist() for k, v in by_kind.items() if k != "step"}
                for name, by_kind in of_all.items()
            }
            for i in range(n)
        ]
        qpos = np.empty((n, len(segments), given.nq))
        qvel = np.empty((n, len(segments), given.nv))
        first_with: dict[str, int] = {}  # most hypotheses change readings alike
        for i, change in enumerate(changes):
            if (known := first_with.setdefault(repr(change), i)) != i:
                qpos[i], qvel[i] = qpos[known], qvel[known]
                continue
            for episode in np.unique(segments.episode):
                rows = np.flatnonzero(segments.episode == episode)
                state = system.complete_state(
                    int(episode), segments.first_step[rows], change
                )
                q, v = state.qpos, state.qvel
                qpos[i, rows], qvel[i, rows] = q, v
        return qpos, qvel

    def _follow_loops(self, offset: Floats) -> Floats:
        """Offsets (n, W, 2 nv) in which joints that loops place follow the others."""
        response = self.system.cache.load_or_compute(
            self.segments, "loop responses", self._loop_responses
        )
        parts = np.split(offset, 2, axis=-1)
        moved = [np.einsum("wij,nwj->nwi", response, part) for part in parts]
        return np.concatenate(moved, axis=-1)

    def _loop_responses(self) -> Floats:
        """(W, nv, nv) how positions move with each other where segments begin."""
        segments, nv = self.segments, self.system.compiler.nominal.nv
        response = np.tile(np.eye(nv), (len(segments), 1, 1))
        for episode in np.unique(segments.episode):
            rows = np.flatnonzero(segments.episode == episode)
            state = self.system.complete_state(int(episode), segments.first_step[rows])
            if state.response is not None:
                response[rows] = state.response
        return response

    def _settle_added_joint(
        self,
        effect: JointAddition,
        place: AddedJointPlace,
        values: Floats,
        qpos: Floats,
        qvel: Floats,
    ) -> None:
        """Deflect an added joint, in place, by the load that it bears at the beginning.

        Where an episode begins in a given state, the added joint begins at 0.

        Args:
            place: of the joint, as the hypotheses' variant numbers it.
            values: (n, p) of the effect.
            qpos: (n, W, nq) of the variant; changed.
            qvel: (n, W, nv) of the variant.
        """
        episodes = [self.system.episodes[i] for i in self.segments.episode]
        is_given = np.array([episode.qpos0 is not None for episode in episodes])
        free = np.flatnonzero(~is_given | (self.segments.first_step > 0))
        for i, model in enumerate(self.hypotheses.models):
            data = mujoco.MjData(model)
            for k in free:
                data.qpos[:], data.qvel[:] = qpos[i, k], qvel[i, k]
                mujoco.mj_forward(model, data)
                load = -float(data.qfrc_bias[place.loaded_dof])
                deflection = effect.compute_deflection(values[i], load)
                qpos[i, k, place.added_qpos] = deflection
                if isinstance(place, SecondJointPlace) and place.is_read_behind:
                    qpos[i, k, place.qpos] -= deflection


def _add_offset(
    model: mujoco.MjModel, qpos: Floats, qvel: Floats, offset: Floats
) -> tuple[Floats, Floats]:
    """States moved in their tangent space, as MuJoCo integrates a position.

    Args:
        qpos: (n, W, nq).
        qvel: (n, W, nv).
        offset: (n, W, 2 nv), of positions and then velocities.

    Returns:
        Positions (n, W, nq) and velocities (n, W, nv).
    """
    qpos = qpos.copy()
    is_plain = np.ones(model.nq, bool)
    for j in range(model.njnt):
        if model.jnt_type[j] in (0, 1):  # mjtJoint: free, ball
            a = int(model.jnt_qposadr[j]) + (3 if model.jnt_type[j] == 0 else 0)
            is_plain[a : a + 4] = False
    if is_plain.all():
        qpos += offset[..., : model.nv]
    else:
        for i, w in np.argwhere(offset[..., : model.nv].any(axis=-1)):
            mujoco.mj_integratePos(model, qpos[i, w], offset[i, w, : model.nv], 1.0)
    return qpos, qvel + offset[..., model.nv :]
