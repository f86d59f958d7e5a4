"""Belief regulation: recurrent memory of every pair of bodies on top of the frozen physics network.

Two recipes behind one interface: `belief` is ours, `paper_recipe` feeds the plain latents of the paper's network to
its LSTM (paper, section on belief regulation; there object and relation functions are swapped in the equations).
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pushgraph.graph import pair_evidence as features
from pushgraph.graph.pair_evidence import FEATURES, pair_evidence
from pushgraph.graph.scene_batch import JOINT_CODES, pairs_of
from pushgraph.graph.watching import Frame
from pushgraph.network import mass_noise
from pushgraph.network.contact_problem import CONTACT_STATE
from pushgraph.network.contract import Foresight, Schema
from pushgraph.network.mass_noise import MassNoise

LATENT_UNIT = 0.4
"""Latents of the shipped `propnet` that are not zero are of this order; an LSTM learns from numbers of order one."""


class Rows(NamedTuple):
    """Pairs of many scenes in a row. receiver, sender: the bodies' places in [batch * bodies], for both directions."""

    scene: Int[Tensor, " rows"]
    pair: Int[Tensor, " rows"]
    receiver: Int[Tensor, "rows 2"]
    sender: Int[Tensor, "rows 2"]

    @classmethod
    def of(cls, chosen: Bool[Tensor, "batch pairs"], bodies: int) -> "Rows":
        """The chosen pairs."""
        scene, pair = chosen.nonzero(as_tuple=True)
        receiver = scene[:, None] * bodies + pairs_of(bodies, chosen.device).t()[pair]
        return cls(scene, pair, receiver, receiver.flip(-1))


class Memory(NamedTuple):
    """What was learnt so far, in rows of pairs (both directions) and bodies."""

    relations: Float[Tensor, "rows 2 state"]
    objects: Float[Tensor, "bodies state"]


class Evidence(NamedTuple):
    """What one frame tells about pairs.

    active: pairs of which something was seen; the memory of others waits. moved: those of which a body may have moved.
    """

    features: Float[Tensor, "batch pairs 2 features"]
    active: Bool[Tensor, "batch pairs"]
    moved: Bool[Tensor, "batch pairs"]


@runtime_checkable
class BeliefRecipe(Schema, Protocol):
    """What `pushgraph train belief` trains.

    PHYSICS: kind of the physics that it stands on. hidden, width: of the memory of bodies, and of both directions of
    pairs. mass_noise: how far evidence about masses is trusted; None if it says nothing of them.
    """

    PHYSICS: str
    hidden: int
    width: int
    mass_noise: MassNoise | None

    def evidence(self, frame: Frame, foresight: Foresight) -> Evidence:
        """What a frame tells, given what was foreseen."""

    def encode(self, evidence: Float[Tensor, "*frames rows 2 evidence"]) -> Float[Tensor, "*frames rows 2 encoded"]:
        """Encode evidence; the part that needs no memory."""

    def step(
        self,
        memory: Memory,
        rows: Rows,
        encoded: Float[Tensor, "rows 2 encoded"],
        active: Bool[Tensor, " rows"],
        moved: Bool[Tensor, " rows"],
    ) -> Memory:
        """One frame."""

    def answer(self, memory: Memory, rows: Rows) -> Float[Tensor, "rows joints"]:
        """Log-odds of the joints, in the order of JOINT_CODES."""


class BeliefNetwork(nn.Module):
    """Ours: joint memory, motions and surprises beside the state of contacts.

    Pairs tell their bodies, and bodies their pairs. Memory begins when a pair is first adjacent. What a pair last
    told stands beside its state in `Memory.relations`, for joint memory alone answers most questions. The state waits
    while both bodies rest, so that a camera's noise does not move it in a pause. An answer also knows the most that
    any pair of the scene says.
    """

    PHYSICS = "contact"
    mass_noise: MassNoise | None

    def __init__(self, hidden: int = 64, latents: int = len(CONTACT_STATE)) -> None:
        super().__init__()
        self.hidden, self.width = hidden, 2 * hidden
        self.encoder = nn.Sequential(
            nn.Linear(len(FEATURES) + latents, 2 * hidden), nn.ReLU(), nn.Linear(2 * hidden, hidden), nn.ReLU()
        )
        self.relation_cell = nn.GRUCell(3 * hidden, hidden)
        self.to_object = nn.Linear(hidden, hidden)
        self.object_cell = nn.GRUCell(hidden, hidden)
        self.to_scene = nn.Linear(2 * hidden, hidden, bias=False)
        self.head = nn.Sequential(nn.Linear(5 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, len(JOINT_CODES)))
        self.mass_noise = MassNoise()

    @staticmethod
    def schema() -> dict[str, Any]:
        """Names of the features and the constants in them, which its weights depend on."""
        return {
            "pair_features": [*features.FEATURES, *CONTACT_STATE],
            "mass_features": list(mass_noise.FEATURES),
            "constants": features.CONSTANTS | {"masses": mass_noise.CONSTANTS},
        }

    def evidence(self, frame: Frame, foresight: Foresight) -> Evidence:
        """What a frame tells, given what was foreseen."""
        of_pairs = pair_evidence(frame, foresight.motion, foresight.linked)
        relations = frame.after.relations
        active = relations.remembered & ~relations.known
        return Evidence(torch.cat((of_pairs, foresight.latents.to(of_pairs.dtype)), -1), active, frame.moved)

    def encode(self, evidence: Float[Tensor, "*frames rows 2 features"]) -> Float[Tensor, "*frames rows 2 hidden"]:
        """Encode evidence; the part that needs no memory."""
        return self.encoder(evidence)

    def step(
        self,
        memory: Memory,
        rows: Rows,
        encoded: Float[Tensor, "rows 2 hidden"],
        active: Bool[Tensor, " rows"],
        moved: Bool[Tensor, " rows"],
    ) -> Memory:
        """One frame."""
        receiver, sender = rows.receiver.flatten(), rows.sender.flatten()
        old = memory.relations.flatten(0, 1)
        ends = memory.objects[receiver], memory.objects[sender]
        encoded_rows = encoded.flatten(0, 1)
        new = self.relation_cell(torch.cat((encoded_rows, *ends), -1), old[:, : self.hidden])
        on, seen = (some[:, None].expand(-1, 2).flatten()[:, None] for some in (active & moved, active))
        state, last = old.split(self.hidden, -1)
        relations = torch.cat((torch.where(on, new, state), torch.where(seen, encoded_rows, last)), -1)
        messages = self.to_object(relations[:, : self.hidden]) * on
        total = torch.zeros_like(memory.objects).index_add(0, receiver, messages)
        count = torch.zeros_like(memory.objects[:, :1]).index_add(0, receiver, on.to(total.dtype))
        # Their mean: a sum over many neighbours makes what goes round from pairs to bodies and back grow every frame.
        objects = self.object_cell(total / count.clamp(min=1), memory.objects)
        objects = torch.where(count > 0, objects, memory.objects)
        return Memory(relations.view_as(memory.relations), objects)

    def answer(self, memory: Memory, rows: Rows) -> Float[Tensor, "rows joints"]:
        """Log-odds of the joints, in the order of JOINT_CODES: the mean of what both directions say."""
        ends = memory.objects[rows.receiver], memory.objects[rows.sender]
        # Where one joint of a scene sits tells where others may. A memory that has not begun is zero and says nothing.
        of_pairs = self.to_scene(memory.relations).relu().amax(1)
        count = int(rows.scene.max()) + 1 if len(rows.scene) else 0
        place = rows.scene[:, None].expand_as(of_pairs)
        of_scenes = of_pairs.new_zeros(count, self.hidden).scatter_reduce(0, place, of_pairs, "amax")
        of_scene = of_scenes[rows.scene][:, None].expand(-1, 2, -1)
        return self.head(torch.cat((memory.relations, *ends, of_scene), -1)).mean(1)


class PaperBelief(nn.Module):
    """The paper's: latents of the relations of its network into an LSTM, then one linear layer; no joint memory.

    A pair's LSTM goes on while it shares edges, and keeps its state while it does not. Its state stands beside its
    output in `Memory.relations`; objects have none, as nothing is asked of them.
    """

    PHYSICS = "propnet"
    mass_noise: MassNoise | None

    def __init__(self, hidden: int = 256, latents: int = 256) -> None:
        super().__init__()
        self.hidden, self.width = hidden, 2 * hidden
        self.mass_noise = None
        self.relation_cell = nn.LSTMCell(latents, hidden)
        self.head = nn.Linear(hidden, len(JOINT_CODES))

    @staticmethod
    def schema() -> dict[str, Any]:
        """It has no features of its own."""
        return {"constants": {"latent_unit": LATENT_UNIT}}

    def evidence(self, frame: Frame, foresight: Foresight) -> Evidence:
        """Latents alone; see `BeliefNetwork.evidence`."""
        active = foresight.linked & ~frame.after.relations.known
        return Evidence(foresight.latents.float() / LATENT_UNIT, active, frame.moved)

    def encode(self, evidence: Float[Tensor, "*frames rows 2 latents"]) -> Float[Tensor, "*frames rows 2 latents"]:
        """The latents themselves."""
        return evidence

    def step(
        self,
        memory: Memory,
        rows: Rows,
        encoded: Float[Tensor, "rows 2 latents"],
        active: Bool[Tensor, " rows"],
        moved: Bool[Tensor, " rows"],
    ) -> Memory:
        """One frame."""
        old = memory.relations.flatten(0, 1)
        new = torch.cat(self.relation_cell(encoded.flatten(0, 1), old.chunk(2, -1)), -1)
        on = active[:, None].expand(-1, 2).flatten()[:, None]
        return Memory(torch.where(on, new, old).view_as(memory.relations), memory.objects)

    def answer(self, memory: Memory, rows: Rows) -> Float[Tensor, "rows joints"]:
        """Log-odds of the joints: the mean of what both directions say."""
        return self.head(memory.relations[..., : self.hidden]).mean(1)


BELIEFS: dict[str, type[BeliefRecipe]] = {"belief": BeliefNetwork, "paper_recipe": PaperBelief}
"""The recipes by name."""
