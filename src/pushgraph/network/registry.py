"""Every network by name: one registry for all that train, save, load or predict with one."""

import inspect
from collections import ChainMap
from collections.abc import Mapping
from typing import Any, Literal, cast

from torch import nn

from pushgraph.errors import NetworkError
from pushgraph.network.belief_network import BELIEFS, BeliefRecipe
from pushgraph.network.contract import PhysicsNetwork, Schema
from pushgraph.network.dynamics import DYNAMICS
from pushgraph.network.lever_dynamics import LEVERS, LeverDynamics
from pushgraph.network.spread_network import SPREADS, SpreadNetwork

Task = Literal["physics", "belief", "spread", "lever-up"]
_OF_TASK: dict[Task, dict[str, Any]] = {"physics": DYNAMICS, "belief": BELIEFS, "spread": SPREADS, "lever-up": LEVERS}
_CONTRACTS: dict[Task, type] = {
    "physics": PhysicsNetwork,
    "belief": BeliefRecipe,
    "spread": SpreadNetwork,
    "lever-up": LeverDynamics,
}
NETWORKS: Mapping[str, type[Schema]] = ChainMap(*_OF_TASK.values())
"""The networks of all tasks; what is registered later is here, too."""


def register_network(name: str, network: type[Schema], task: Task = "physics") -> None:
    """Make a network known by name, in this process: to training, checkpoints and prediction.

    network: an `nn.Module` that keeps the contract of its task (`pushgraph.network.contract`). Processes that are
    started have to import the module that calls this, too. Raises NetworkError if the name is taken, or it is none.
    """
    networks_of(task)
    if NETWORKS.get(name, network) is not network:
        raise NetworkError(f"{name!r}: there is a network of this name already, {NETWORKS[name].__qualname__}")
    if not (isinstance(network, type) and issubclass(network, nn.Module)):
        raise NetworkError(f"{name!r}: must be a class derived from torch.nn.Module, got {network!r}")
    _OF_TASK[task][name] = network


def networks_of(task: str) -> Mapping[str, type[Schema]]:
    """The networks of a task, by name; raises NetworkError if there is no such task."""
    if task not in _OF_TASK:
        raise NetworkError(f"no task {task!r}; valid: {', '.join(_OF_TASK)}")
    return _OF_TASK[task]


def build_network(name: str, config: Mapping[str, Any]) -> nn.Module:
    """The network of this name with first weights; raises NetworkError if it does not keep its contract."""
    if name not in NETWORKS:
        valid = ", ".join(one for networks in _OF_TASK.values() for one in networks)
        raise NetworkError(f"no network {name!r}; valid: {valid}; import what registers your own")
    try:
        network = cast(Any, NETWORKS[name])(**config)
    except TypeError as error:
        raise NetworkError(f"{name!r}: cannot be built from {dict(config)}: {error}") from error
    contract = next(_CONTRACTS[task] for task, networks in _OF_TASK.items() if name in networks)
    lacking = [member for member in _members(contract) if not hasattr(network, member)]
    if lacking or not isinstance(network, nn.Module):
        raise NetworkError(
            f"{name!r}: {type(network).__qualname__} lacks {', '.join(lacking) or 'torch.nn.Module as its base'}; see "
            f"{contract.__module__}.{contract.__qualname__}"
        )
    return network


def _members(contract: type) -> list[str]:
    """Names of what a protocol asks for, or a class offers beside what every module has."""
    bases = [base for base in contract.__mro__ if base.__module__.startswith("pushgraph.")]
    names = {name for base in bases for name in (*inspect.get_annotations(base), *vars(base))}
    return sorted(name for name in names if not name.startswith("_"))
