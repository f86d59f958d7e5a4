"""Devices by name: what torch computes on."""

import torch
from torch import nn

from pushgraph.errors import DeviceError


def device_of(name: str | torch.device) -> torch.device:
    """The device of a name; raises DeviceError if there is none of this name here."""
    try:
        device = torch.device(name)
    except RuntimeError:
        raise DeviceError(f"device: no device {str(name)!r}; valid: {', '.join(devices())}") from None
    if device.type == "cuda" and not (device.index or 0) < gpus():
        found = "CUDA finds no GPU here" if gpus() == 0 else f"there are {gpus()} GPUs"
        raise DeviceError(f"device: no {str(name)!r}: {found}; valid: {', '.join(devices())}")
    return device


def place_of(network: object) -> torch.device:
    """The device that a network computes on, and that its inputs have to be on; the processor if it is no module."""
    first = next(network.parameters(), None) if isinstance(network, nn.Module) else None
    return torch.device("cpu") if first is None else first.device


def gpus() -> int:
    """How many GPUs CUDA finds; none if torch was built without CUDA."""
    return torch.cuda.device_count() if torch.cuda.is_available() else 0


def devices() -> list[str]:
    """Names of the devices that are here."""
    return ["cpu", *["cuda"] * (gpus() > 0), *(f"cuda:{index}" for index in range(gpus()))]
