"""Masses: the evidence of predictions, samples of the posterior, and what a belief says of simulated pushes."""

import math

import numpy as np
import pytest
import torch

import pushgraph as pg
from pushgraph import mass_memory
from pushgraph.belief import BeliefModel
from pushgraph.errors import BeliefError
from pushgraph.evaluation.recording import record, watch
from pushgraph.graph.contact_graph import GRAVITY
from pushgraph.graph.mass_evidence import Rows, linearize
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import Control, start
from pushgraph.graph.tool_wrench import wrench_on_tool
from pushgraph.mass_chains import MassChains
from pushgraph.mass_prior import MASS_CLASSES, class_of, prior_quantiles, shares_of
from pushgraph.network.mass_noise import Evidence
from pushgraph.physics import PhysicsPredictor
from pushgraph.regulator import BeliefRegulator
from pushgraph.simulation.planar import simulate

FRICTION = 0.45


def disc(name: str, x: float, y: float, mass: float | None, diameter: float = 0.12) -> pg.Body:
    shape = pg.Cylinder(diameter=diameter)
    return pg.Body(name=name, shape=shape, pose_world_from_body=(x, y, 0.0), mass=mass)


def row_of(*masses: float, friction: float | None = FRICTION) -> pg.Scene:
    """Discs that stand askew before the tool, which pushes them by 25 cm."""
    bodies = tuple(disc(f"disc{k}", 0.13 * k, 0.025 * (-1) ** k, mass) for k, mass in enumerate(masses))
    push = pg.Push(start=(-0.13, 0.0), end=(0.12, 0.0), speed=0.15)
    return pg.Scene(bodies=bodies, pushes=(push,), table=pg.Table(friction=friction))


def weigh(scene: pg.Scene, track: pg.Track, force: bool = False, model: BeliefModel | str = "belief"):
    regulator = BeliefRegulator(scene, model, given=True, weigh=True)
    for k, (poses, down) in enumerate(track.frames()):
        regulator.observe(poses, down, track.wrench[k] if force else None)
    return {mass.body: mass for mass in regulator.masses()}


def weighed_memory(track: pg.Track, model: BeliefModel) -> mass_memory.MassMemory:
    """What is remembered of the masses of a track's scene in its end."""
    scenes = batch_scenes([track.scene])
    scenes = scenes._replace(mass_known=torch.zeros_like(scenes.mass_known))
    *_, last = watch(model, scenes, record([track], len(track.times)))
    assert last.masses is not None
    return last.masses


@pytest.fixture(scope="module")
def model() -> BeliefModel:
    return BeliefModel.load("belief")


@pytest.fixture(scope="module")
def unequal() -> pg.Track:
    return simulate(row_of(9.0, 0.3))


def no_evidence(scenes) -> Evidence:
    variables = scenes.mass.shape[1] + 1
    return Evidence(torch.zeros(1, variables, variables).double(), torch.zeros(1, variables).double())


def unweighed(*masses: float):
    scenes = batch_scenes([row_of(*masses)])
    return scenes._replace(mass_known=torch.zeros_like(scenes.mass_known))


def test_what_slides_pulls_with_friction_times_weight() -> None:
    scenes = batch_scenes([row_of(2.0, 0.5)])
    poses = torch.tensor(row_of(2.0, 0.5).poses_world_from_body)[None]
    motion = torch.zeros(1, 2, 3).double()
    motion[0, 0] = torch.tensor([0.006, 0.008, 0.0])
    tool = torch.tensor([[0.0, -0.1, 0.0]]).double()
    felt = wrench_on_tool(scenes, poses, motion, motion, tool, torch.zeros(1))
    force = FRICTION * 2.0 * GRAVITY
    torch.testing.assert_close(felt.wrench[0, :2], -force * torch.tensor([0.6, 0.8]).double(), rtol=1e-4, atol=1e-4)
    x, y = poses[0, 0, 0] + 0.003, poses[0, 0, 1] + 0.004 + 0.1
    moment = x * felt.wrench[0, 1] - y * felt.wrench[0, 0]
    torch.testing.assert_close(felt.wrench[0, 2], moment, rtol=1e-3, atol=1e-3)


def test_getting_faster_takes_force() -> None:
    scenes = batch_scenes([row_of(2.0, 0.5)])._replace(table_friction=torch.zeros(1))
    poses = torch.tensor(row_of(2.0, 0.5).poses_world_from_body)[None]
    last = torch.zeros(1, 2, 3).double()
    motion = last.clone()
    motion[0, 0, 0] = 0.0025
    felt = wrench_on_tool(scenes, poses, last, motion, torch.zeros(1, 3).double(), torch.zeros(1))
    assert felt.wrench[0, 0] == pytest.approx(-2.0 * 0.0025 / 0.05**2, rel=1e-6)


def test_sensitivities_are_those_of_predictions_and_add_up_to_zero() -> None:
    scene = row_of(2.0, 0.5)
    dynamics = PhysicsPredictor.load("contact").dynamics
    state = start(batch_scenes([scene]), torch.tensor(scene.poses_world_from_body)[None]).double()
    tool, motion = torch.tensor([[-0.109, 0.0, 0.0]]).double(), torch.tensor([[0.007, 0.0, 0.0]]).double()
    down, one = torch.ones(1, dtype=torch.bool), torch.ones(1).double()
    control = Control(tool, motion, motion, down, one, one, one * torch.inf)
    log_mass = torch.tensor([[2.0, 0.5, FRICTION]]).double().log()
    moves = torch.ones(1, 2, dtype=torch.bool)
    carried = torch.zeros(1, 2, 3, 3).double()
    rows = Rows(torch.zeros(1, dtype=torch.long), state.poses, state.motions, carried, moves, torch.zeros(1))
    small = torch.full((1, 3), 0.01).double()
    linearized = linearize(dynamics, state, control, rows, log_mass, small)
    torch.testing.assert_close(linearized.motion, dynamics(state, control).motion)
    total = linearized.sensitivity.sum(-1)
    assert total.abs().max() < 1e-9
    ends = [
        dynamics(state._replace(scenes=state.scenes._replace(mass=torch.tensor([[mass, 0.5]]).double())), control)
        for mass in (2.0 * math.exp(0.01), 2.0 * math.exp(-0.01))
    ]
    expected = (ends[0].motion - ends[1].motion) / 0.02
    torch.testing.assert_close(linearized.sensitivity[..., :2, 0], expected[..., :2], rtol=0.05, atol=1e-6)


def test_without_evidence_the_answer_is_the_prior() -> None:
    scenes = unweighed(1.5, 0.3, 9.0)
    answer = MassChains.begin(scenes, [MASS_CLASSES]).answer(no_evidence(scenes), scenes)
    assert (answer.probabilities - 1 / 3).abs().max() < 1e-3
    median, low, high = prior_quantiles(MASS_CLASSES, np.array([0.5, 0.16, 0.84]))
    for said, expected in ((answer.median, median), (answer.low, low), (answer.high, high)):
        assert said[0].numpy() == pytest.approx(np.full(3, expected), rel=0.05)


def prior_density(mass: np.ndarray) -> np.ndarray:
    """Of masses (kg), per kg."""
    return sum(
        share * ((mass >= one.lowest) & (mass <= one.highest)) / (one.highest - one.lowest)
        for share, one in zip(shares_of(MASS_CLASSES), MASS_CLASSES, strict=True)
    )


def test_known_ratios_give_the_exact_posterior() -> None:
    """Against the integral over the common scale, of masses 9 and 1.6 kg: heavy and normal, or normal and light."""
    scenes = unweighed(9.0, 1.6)
    ratio, tight = math.log(9.0 / 1.6), 1e4
    contrast = torch.tensor([1.0, -1.0, 0.0]).double()
    information = tight * torch.outer(contrast, contrast)[None]
    evidence = Evidence(information, tight * ratio * contrast[None])
    chains = MassChains.begin(scenes, [MASS_CLASSES])
    for number in range(40):
        chains = chains.sweep(evidence, torch.ones(1, dtype=torch.bool), number)
    answer = chains.answer(evidence, scenes)

    heavy = np.linspace(0.2, 10.0, 400_001)
    # d(ratio) = d(lighter) * heavy / lighter^2
    weight = prior_density(heavy) * prior_density(heavy / math.exp(ratio)) * heavy
    expected = [weight[(heavy >= one.lowest) & (heavy <= one.highest)].sum() / weight.sum() for one in MASS_CLASSES]
    assert answer.probabilities[0, 0].numpy() == pytest.approx(np.array(expected), abs=0.03)
    middle = heavy[np.searchsorted(weight.cumsum(), weight.sum() / 2)]
    assert float(answer.median[0, 0]) == pytest.approx(middle, rel=0.03)


def shares_of_moves(chains: MassChains, evidence: Evidence) -> np.ndarray:
    """Share of each class in samples that are moved from the prior on, [bodies classes]."""
    every, samples = torch.ones(1, dtype=torch.bool), []
    for number in range(600):
        chains = chains.sweep(evidence, every, number)
        samples.append(chains.samples[0, :, :-1])
    weights = np.exp(np.concatenate(samples[100:]))[..., None]
    lowest, highest = ([getattr(one, end) for one in MASS_CLASSES] for end in ("lowest", "highest"))
    return ((weights > np.array(lowest) - 1e-6) & (weights < np.array(highest) + 1e-6)).mean(0)


def shares_answered(chains: MassChains, evidence: Evidence) -> np.ndarray:
    """Probability of each class, as it is answered, [bodies classes]."""
    return chains.answer(evidence, unweighed(*[1.0] * (chains.samples.shape[-1] - 1))).probabilities[0].numpy()


@pytest.mark.parametrize("shares", [shares_of_moves, shares_answered])
def test_pairs_cross_the_gaps_between_classes_together(shares) -> None:
    """Two pairs of equal bodies, 9 and 1.5 kg, each tied firmly, and one to the other loosely: against the integral
    over the two masses. Evidence comes all at once, so chains begin with pairs of any class."""
    firm, loose = 1e5, 50.0
    first, second, between = (
        torch.tensor(row).double() for row in ([1.0, -1, 0, 0, 0], [0, 0, 1.0, -1, 0], [1.0, 0, -1, 0, 0])
    )
    ratio = math.log(9.0 / 1.5)
    information = firm * (torch.outer(first, first) + torch.outer(second, second))
    information += loose * torch.outer(between, between)
    evidence = Evidence(information[None], (loose * ratio * between)[None])
    probabilities = shares(MassChains.begin(unweighed(9.0, 9.0, 1.5, 1.5), [MASS_CLASSES]), evidence)

    mass = np.linspace(0.2, 10.0, 2_001)
    of_pair = prior_density(mass) ** 2 * mass  # two bodies of equal mass: d(log ratio) = d(mass) / mass
    apart = np.log(mass)[:, None] - np.log(mass) - ratio
    weight = np.outer(of_pair, of_pair) * np.exp(-loose / 2 * apart**2)
    for bodies, of_mass in (((0, 1), weight.sum(1)), ((2, 3), weight.sum(0))):
        expected = of_classes(mass, of_mass)
        for body in bodies:
            assert probabilities[body] == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("shares", [shares_of_moves, shares_answered])
def test_what_is_known_of_three_at_once_is_followed_across_the_gaps(shares) -> None:
    """Of the third only that it is the geometric mean of the others: against the integral over those two."""
    firm, row = 1e4, torch.tensor([1.0, 1.0, -2.0, 0.0]).double()
    evidence = Evidence((firm * torch.outer(row, row))[None], torch.zeros(1, 4).double())
    probabilities = shares(MassChains.begin(unweighed(9.0, 0.3, 1.64), [MASS_CLASSES]), evidence)
    mass = np.linspace(0.2, 10.0, 2_001)
    mean = np.sqrt(np.outer(mass, mass))
    weight = np.outer(prior_density(mass), prior_density(mass)) * prior_density(mean) * mean
    of_first, of_mean = of_classes(mass, weight.sum(1)), of_classes(mean.ravel(), weight.ravel())
    for body, expected in ((0, of_first), (1, of_first), (2, of_mean)):
        assert probabilities[body] == pytest.approx(expected, abs=0.03)


def of_classes(mass: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Share of the weight in each class."""
    return np.array([weight[(mass >= one.lowest) & (mass <= one.highest)].sum() for one in MASS_CLASSES]) / weight.sum()


def test_a_body_pushed_alone_shows_nothing_of_its_mass(model: BeliefModel) -> None:
    scene = row_of(9.5)
    mass = weigh(scene, simulate(scene), model=model)["disc0"]
    variation = sum(abs(share - 1 / 3) for share in mass.classes.values()) / 2
    assert variation < 0.1
    _, low, high = prior_quantiles(MASS_CLASSES, np.array([0.5, 0.16, 0.84]))
    assert (mass.mass[2] - mass.mass[1]) == pytest.approx(high - low, rel=0.15)
    assert mass.ratios == {}


def test_a_heavy_and_a_light_body_are_told_apart(unequal: pg.Track, model: BeliefModel) -> None:
    masses = weigh(unequal.scene, unequal, model=model)
    assert [masses[name].likeliest for name in ("disc0", "disc1")] == ["heavy", "light"]
    median, low, high = masses["disc0"].ratios["disc1"]
    assert low < median < high
    assert median == pytest.approx(30, rel=0.3)
    assert masses["disc1"].ratios["disc0"][0] == pytest.approx(1 / median, rel=0.05)


@pytest.mark.parametrize("mass", [0.35, 1.4, 9.2])
def test_a_force_sensor_shows_kilograms(mass: float, model: BeliefModel) -> None:
    scene = row_of(mass)
    said = weigh(scene, simulate(scene), force=True, model=model)["disc0"]
    assert said.likeliest == MASS_CLASSES[class_of(MASS_CLASSES, mass)].name
    assert said.mass[0] == pytest.approx(mass, rel=0.1)
    assert said.slide[0] == pytest.approx(FRICTION * mass * GRAVITY, rel=0.1)


def test_where_friction_is_unknown_the_force_to_slide_is_known_and_the_mass_less(model: BeliefModel) -> None:
    scene = row_of(1.5)
    track = simulate(scene)
    known = weigh(scene, track, force=True, model=model)["disc0"]
    unknown = weigh(row_of(1.5, friction=None), track, force=True, model=model)["disc0"]
    assert unknown.slide[0] == pytest.approx(FRICTION * 1.5 * GRAVITY, rel=0.1)
    assert (unknown.slide[2] - unknown.slide[1]) / unknown.slide[0] < 0.3
    assert unknown.mass[2] / unknown.mass[1] > 1.3 * known.mass[2] / known.mass[1]


def test_frames_are_looked_at_again_until_their_evidence_is_about_the_masses_assumed(
    unequal: pg.Track, model: BeliefModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def farthest() -> float:
        """How far the masses assumed now are from those that any kept frame's evidence is about."""
        memory = weighed_memory(unequal, model)
        change = memory.log_mass - memory.kept.log_mass
        return float((change[:, None] @ memory.kept.evidence.information @ change[..., None]).max())

    assert farthest() < mass_memory.STALE
    monkeypatch.setattr(mass_memory, "_stale", lambda memory, telling: torch.zeros(0, dtype=torch.long))
    assert farthest() > 1.0


def test_side_by_side_is_as_one_at_a_time(unequal: pg.Track, model: BeliefModel) -> None:
    other = simulate(row_of(0.4, 1.8))
    tracks = [unequal, other]
    scenes = batch_scenes([track.scene for track in tracks])
    scenes = scenes._replace(mass_known=torch.zeros_like(scenes.mass_known))
    frames = min(len(track.times) for track in tracks)
    poses = torch.tensor(np.stack([track.poses[:frames] for track in tracks]))
    down = torch.tensor(np.stack([track.down[:frames] for track in tracks]))
    seen = torch.ones(2, 2, dtype=torch.bool)

    def watch(chosen: slice):
        rows = torch.arange(2)[chosen]
        watch = None
        for k in range(frames):
            columns = (poses[rows, k, 1:], poses[rows, k, 0], down[rows, k], seen[rows])
            some = scenes.take(rows)
            watch = model.begin(some, *columns) if watch is None else model.observe(watch, *columns)
        return model.masses(watch)

    together = watch(slice(None))
    for k in range(2):
        alone = watch(slice(k, k + 1))
        torch.testing.assert_close(together.probabilities[k], alone.probabilities[0], atol=0.03, rtol=0)
        torch.testing.assert_close(together.median[k], alone.median[0], atol=1e-3, rtol=0.05)


def test_known_masses_are_kept_and_given_to_their_neighbours(unequal: pg.Track, model: BeliefModel) -> None:
    first, second = unequal.scene.bodies
    scene = unequal.scene.replace(bodies=(first.replace(mass=9.0), second.replace(mass=None)))
    regulator = BeliefRegulator(scene, model, given=True)
    for poses, down in unequal.frames():
        regulator.observe(poses, down)
    (said,) = regulator.masses()
    assert (said.body, said.likeliest) == ("disc1", "light")
    assert said.mass[0] == pytest.approx(0.3, rel=0.3)
    assert regulator.scene().bodies[0].mass == 9.0
    assert regulator.scene().bodies[1].mass == said.mass[0]


def test_lost_tags_and_missing_forces_are_gaps(unequal: pg.Track, model: BeliefModel) -> None:
    regulator = BeliefRegulator(unequal.scene, model, given=True, weigh=True)
    for k, (poses, down) in enumerate(unequal.frames()):
        poses = poses.copy()
        if 14 <= k < 18:
            poses[2] = np.nan
        regulator.observe(poses, down, np.full(3, np.nan) if k % 3 else unequal.wrench[k])
    masses = {mass.body: mass for mass in regulator.masses()}
    assert [masses[name].likeliest for name in ("disc0", "disc1")] == ["heavy", "light"]


@pytest.mark.parametrize("wrench", [(np.inf, 0.0, 0.0), (np.nan, 1.0, 0.0), (2000.0, 0.0, 0.0)])
def test_forces_that_no_sensor_gives_are_refused(wrench, unequal: pg.Track, model: BeliefModel) -> None:
    regulator = BeliefRegulator(unequal.scene, model, given=True, weigh=True)
    poses, down = next(iter(unequal.frames()))
    with pytest.raises(BeliefError, match="wrench at frame 0"):
        regulator.observe(poses, down, np.array(wrench))


def test_where_the_scene_stands_does_not_matter(unequal: pg.Track, model: BeliefModel) -> None:
    moved = pg.pose.compose(np.array([0.3, -0.2, 1.0]), unequal.poses)
    bodies = tuple(
        body.replace(pose_world_from_body=tuple(place))
        for body, place in zip(unequal.scene.bodies, moved[0, 1:].tolist(), strict=True)
    )
    regulator = BeliefRegulator(unequal.scene.replace(bodies=bodies, pushes=()), model, given=True, weigh=True)
    for k in range(len(moved)):
        regulator.observe(moved[k], bool(unequal.down[k]))
    here, there = weigh(unequal.scene, unequal, model=model), {mass.body: mass for mass in regulator.masses()}
    for name in here:
        assert there[name].mass[0] == pytest.approx(here[name].mass[0], rel=0.05)
