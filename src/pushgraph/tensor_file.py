"""Tensors with a JSON header and a hash of both, in one safetensors file; there is no pickle."""

import hashlib
import json
import os
from collections.abc import Mapping
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from pushgraph.errors import PushGraphError
from pushgraph.storage import replacing


def save_tensors(path: str | os.PathLike, header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Write a file, whole or not at all. header: with `format` and `version`."""
    hashed = dict(header) | {"hash": content_hash(header, tensors)}
    with replacing(path) as temporary:
        temporary.write_bytes(save(dict(tensors), {"pushgraph": json.dumps(hashed, sort_keys=True)}))


def load_tensors(
    path: str | os.PathLike, what: str, format: str, version: int, error: type[PushGraphError], remedy: str
) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The header, its hash included, and the tensors; raises `error` if the file is damaged or of another kind.

    what: it should be, such as "checkpoint". remedy: what to do about one of another version.
    """
    try:
        with safe_open(path, "pt") as file:
            header = json.loads((file.metadata() or {}).get("pushgraph", "{}"))
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (OSError, SafetensorError, ValueError) as fault:
        reason = "no such file" if isinstance(fault, FileNotFoundError) else f"it may be truncated: {fault}"
        raise error(f"{path}: cannot read this {what}: {reason}") from None
    if not isinstance(header, dict) or header.get("format") != format:
        raise error(f"{path}: no {what} of pushgraph: its header must have format {format!r}")
    if header.get("version") != version:
        raise error(f"{path}: {what} version {header.get('version')}; this pushgraph reads {version}: {remedy}")
    if header.get("hash") != content_hash({name: header[name] for name in header if name != "hash"}, tensors):
        raise error(f"{path}: its content does not match its hash: it was changed or damaged")
    return header, tensors


def content_hash(header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of a header without its hash, and of all tensors with their names, types and shapes."""
    digest = hashlib.sha256(json.dumps(dict(header), sort_keys=True).encode())
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {list(tensors[name].shape)}".encode())
        digest.update(tensors[name].contiguous().view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
