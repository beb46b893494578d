"""MJX engine: bodies and joint targets in, readings at rest out; the tree is data.

The servos hold their angles, so a candidate is one free body whose contact spheres,
center of mass and inertia follow the planned joint angles. MJX's collisions, contact
constraints and solver move it; one compiled program serves every attachment tree of
an anatomy.
"""

import functools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints
from ._jax import prepare_jax
from ._mjx_body import (
    Parts,
    compute_torso_constants,
    list_row_shapes,
    list_sphere_owners,
    pack_parts,
    plan_motion,
)
from ._program_cache import keep_exported, read_exported
from .arrays import pack_bodies
from .readings import Readings, compute_readings

if TYPE_CHECKING:
    from jax import Array, ShapeDtypeStruct
    from jax.export import Exported
    from jax.sharding import Mesh, NamedSharding
    from jax.stages import Compiled

# Joints move from 0 to their target, then hold [s]. Chosen: the fastest that rests
# where the reference does, which takes 2 s and 1 s.
RAMP, HOLD = 1.5, 0.5
TIMESTEP = 0.01  # [s] paper A's (papers.md 1.1)
SERVO_LAG = 0.0155  # [s] (kv + damping) / kp of mjcf.Physics: servos trail so far
SETTLED_LAGS = 5  # the joints stand still so many lags after the ramp; chosen
FASTEST = 20.0  # [m/s or rad/s] what still moves faster has diverged; chosen
# Simulations on each device in a call of the compiled program; chosen: on CPU cores 32
# to 256 are equally fast, and the fewest make a short call short; GPUs not measured.
CPU_ROWS, GPU_ROWS = 32, 4096


class Mjx:
    """Simulates a rigid, reshaping body for each candidate, on every device.

    Attributes:
        ramp: [s] joints move from 0 to their target.
        hold: [s] then hold.
    """

    name = "mjx"

    def __init__(
        self, ramp: float = RAMP, hold: float = HOLD, *, batch: int | None = None
    ) -> None:
        """`batch` simulations in a call; None: as many as suit the devices."""
        self.ramp, self.hold, self._batch = ramp, hold, batch

    @property
    def batch(self) -> int:
        """Simulations in a call of the compiled program, whatever N is."""
        devices = prepare_jax().devices()
        rows = CPU_ROWS if devices[0].platform == "cpu" else GPU_ROWS
        return self._batch or rows * len(devices)

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad]."""
        targets = np.asarray(targets, float)
        with np.errstate(all="ignore"):  # a candidate without sense fails, silently
            rest = self._simulate_to_rest(bodies, targets)
        sizes = np.hstack([bodies.length, bodies.thickness, bodies.mass])
        rest[~((sizes > 0).all(axis=1) & (rest[:, 4] < FASTEST))] = np.nan
        return compute_readings(
            bodies, pack_bodies(bodies), rest[:, :3], rest[:, 3], rest[:, 5:], targets
        )

    def prepare(self, anatomy: Anatomy) -> bool:
        """Load what an earlier run compiled for an anatomy; may run in any thread.

        Returns:
            Whether there was something; else `compile` has to do it.
        """
        kept = self._describe_program(anatomy).is_kept()
        if kept:
            self.compile(anatomy)
        return kept

    def compile(self, anatomy: Anatomy) -> "Compiled":
        """The compiled batch of simulations of an anatomy.

        In the main thread alone where none is kept: tracing imports MJX, while which
        nothing reaches standard output.
        """
        return _compile_program(self._describe_program(anatomy))

    def _describe_program(self, a: Anatomy) -> "_Program":
        """What is compiled for an anatomy."""
        devices, batch = prepare_jax().devices(), self.batch
        count = max(n for n in range(1, len(devices) + 1) if batch % n == 0)
        robot, times = (a.size, list_sphere_owners(a), a.feet), (self.ramp, self.hold)
        return _Program(*robot, *times, batch, count, devices[0].platform)

    def _simulate_to_rest(self, bodies: Bodies, targets: Floats) -> Floats:
        """(N, 5 + F) what `_simulate` returns for each row."""
        a = bodies.anatomy
        batch = self.batch
        program = self.compile(a)
        rows = *pack_parts(bodies), targets
        same = [np.float32(x) for x in (compute_torso_constants(a), a.torso_half[2])]
        results = []
        for start in range(0, len(bodies), batch):  # queued; the devices work meanwhile
            chunk = [_pad_rows(x[start : start + batch], batch) for x in rows]
            results.append(program(*chunk, *same))
        rest = np.empty((len(results) * batch, 5 + len(a.feet)))
        for i, result in enumerate(results):
            rest[i * batch : (i + 1) * batch] = result
        return rest[: len(bodies)]


def _pad_rows(rows: Ints | Floats, count: int) -> np.ndarray:
    """These rows for the device; the last one repeated up to `count`."""
    kind = np.int32 if rows.dtype.kind == "i" else np.float32
    padding = [(0, count - len(rows))] + [(0, 0)] * (rows.ndim - 1)
    return np.pad(rows.astype(kind), padding, mode="edge")


class _Program(NamedTuple):
    """All that a compiled batch of simulations depends on, beside its code.

    Attributes:
        owner: part of each contact sphere.
        feet: parts whose tips are measured.
        ramp: [s] joints move from 0 to their target.
        hold: [s] then hold.
    """

    size: int
    owner: tuple[int, ...]
    feet: tuple[int, ...]
    ramp: float
    hold: float
    batch: int
    devices: int
    platform: str

    def is_kept(self) -> bool:
        """Whether an earlier run left it, so that it need not be traced."""
        return read_exported(self) is not None

    def trace(self) -> "Exported":
        """The program as `jax.export` has it: rows of `Parts`, targets and a torso."""
        jax = prepare_jax()
        from jax import export
        from jax.sharding import PartitionSpec

        split, shared = PartitionSpec("rows"), PartitionSpec()
        program = jax.shard_map(
            jax.vmap(
                functools.partial(_simulate_body, self), in_axes=(0, 0, None, None)
            ),
            mesh=self._make_mesh(),
            in_specs=(split, split, shared, shared),
            out_specs=split,
            check_vma=False,
        )
        flat = jax.jit(
            lambda *x: program(Parts(*x[:-3]), *x[-3:]), **self._place_arrays()
        )
        return export.export(flat)(*self._list_arrays())

    def compile(self) -> "Compiled":
        """The program for this machine's devices, traced if no earlier run did it."""
        jax = prepare_jax()
        traced = read_exported(self) or keep_exported(self, self.trace())
        placed = jax.jit(traced.call, **self._place_arrays())
        return placed.lower(*self._list_arrays()).compile()

    def _list_arrays(self) -> list["ShapeDtypeStruct"]:
        """Shapes and types of the program's arrays: rows, and two that all share."""
        from jax import ShapeDtypeStruct

        rows = (*list_row_shapes(self.size, len(self.owner)), (self.size,))
        kinds = [np.int32, *[np.float32] * (len(rows) - 1)]  # parents come first
        shapes = [*((self.batch, *row) for row in rows), (4,), ()]
        kinds += [np.float32, np.float32]
        return [ShapeDtypeStruct(*one) for one in zip(shapes, kinds, strict=True)]

    def _make_mesh(self) -> "Mesh":
        from jax.sharding import Mesh

        devices = prepare_jax().devices()
        return Mesh(np.array(devices[: self.devices]), ("rows",))

    def _place_arrays(self) -> "dict[str, NamedSharding | tuple[NamedSharding, ...]]":
        """Where the program's arrays lie: rows split among the devices."""
        from jax.sharding import NamedSharding, PartitionSpec

        mesh, count = self._make_mesh(), len(self._list_arrays()) - 2
        split = NamedSharding(mesh, PartitionSpec("rows"))
        shared = NamedSharding(mesh, PartitionSpec())
        inputs = (*[split] * count, shared, shared)
        return {"in_shardings": inputs, "out_shardings": split}


@functools.cache
def _compile_program(program: _Program) -> "Compiled":
    """The compiled program, once in a process."""
    return program.compile()


def _simulate_body(
    program: _Program, body: Parts, target: "Array", torso: "Array", height: "Array"
) -> "Array":
    """Simulate one body from lying at rest.

    Returns:
        (5 + F): up in the torso's frame (3), height of the torso's center (1) [m],
        fastest motion left (1), height of each foot's lowest point (F) [m].
    """
    import jax
    import jax.numpy as jnp

    from ._mjx_step import (
        BodyPose,
        BodyState,
        build_sphere_model,
        convert_quaternion,
        step_body,
    )

    ramp = program.ramp
    moving = round((ramp + SETTLED_LAGS * SERVO_LAG) / TIMESTEP)
    share = _compute_servo_share(np.arange(moving + 1) * TIMESTEP, ramp).astype(
        np.float32
    )
    plan = plan_motion(body, torso, program.owner, target[:, None] * share, TIMESTEP)
    model, data = build_sphere_model(TIMESTEP)

    def advance(state: BodyState, k: "Array") -> tuple[BodyState, None]:
        now, then = jnp.minimum(k, moving), jnp.minimum(k + 1, moving)
        spheres = plan.spheres[now]
        flow = (plan.spheres[then] - spheres) / TIMESTEP
        inertia, spin = plan.inertia[now], plan.spin[now]
        pose = BodyPose(spheres, flow, body.radius, inertia, spin, plan.mass)
        return step_body(model, data, state, pose), None

    place = plan.center[0] + jnp.array([0, 0, height])
    still = jnp.zeros(6)
    start = BodyState(
        jnp.append(place, jnp.array([1.0, 0, 0, 0])), still, still[:3], still
    )
    steps = jnp.arange(round((ramp + program.hold) / TIMESTEP))
    end, _ = jax.lax.scan(advance, start, steps)
    up = convert_quaternion(end.pose[3:])[2]
    level = end.pose[2] + plan.spheres[-1] @ up - body.radius
    first_tip = 8 + target.shape[0] - 1
    tips = level[first_tip + np.asarray(program.feet, int)]
    lift = end.pose[2] - plan.center[-1] @ up
    fastest = jnp.abs(end.velocity).max()
    return jnp.concatenate([up, lift[None], fastest[None], tips])


def _compute_servo_share(time: np.ndarray, ramp: float) -> Floats:
    """Share of the target reached by servos that trail a ramp by SERVO_LAG."""
    trail = SERVO_LAG / ramp * (1 - np.exp(-np.minimum(time, ramp) / SERVO_LAG))
    late = np.exp(-np.maximum(time - ramp, 0) / SERVO_LAG)
    share = np.minimum(time / ramp, 1) - trail * late
    return np.where(time > ramp + (SETTLED_LAGS - 0.5) * SERVO_LAG, 1.0, share)
