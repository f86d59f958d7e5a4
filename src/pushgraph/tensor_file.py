"""Tensors with a JSON header and a hash of both, in one safetensors file; there is no pickle."""

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from pushgraph.errors import PushGraphError
from pushgraph.json_file import parse_object, validated
from pushgraph.record import Record
from pushgraph.storage import replacing, size_of


class Header(Record):
    """Base of what headers say; `format` and `version` have one valid value each, their default."""

    hash: str


def save_tensors(path: str | os.PathLike, header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Write a file, whole or not at all. header: with `format` and `version`."""
    hashed = dict(header) | {"hash": content_hash(header, tensors)}
    with replacing(path) as temporary:
        temporary.write_bytes(save(dict(tensors), {"pushgraph": json.dumps(hashed, sort_keys=True)}))


def load_tensors(
    path: str | os.PathLike, what: str, header: type[Header], error: type[PushGraphError], remedy: str
) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The header's fields, its hash included, and the tensors; raises `error` if the file is damaged or another kind.

    what: it should be, such as "checkpoint". remedy: what to do about one of another version.
    """
    try:
        size_of(Path(path))
        with safe_open(path, "pt") as file:
            text = (file.metadata() or {}).get("pushgraph", "{}")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (OSError, SafetensorError, ValueError) as fault:
        reason = "no such file" if isinstance(fault, FileNotFoundError) else f"it may be truncated: {fault}"
        raise error(f"{path}: cannot read this {what}: {reason}") from None
    where = f"{path}: header"
    fields = parse_object(text, where, what, error)
    format, version = (header.model_fields[name].default for name in ("format", "version"))
    if fields.get("format") != format:
        raise error(f"{path}: no {what} of pushgraph: its header must have format {format!r}")
    if fields.get("version") != version:
        raise error(f"{path}: {what} version {fields.get('version')}; this pushgraph reads {version}: {remedy}")
    if fields.get("hash") != content_hash({name: fields[name] for name in fields if name != "hash"}, tensors):
        raise error(f"{path}: its content does not match its hash: it was changed or damaged")
    validated(header, text, where, error)
    return fields, tensors


def check_tensors(tensors: Mapping[str, Tensor], needed: Mapping[str, Tensor]) -> str:
    """Say which tensor is missing, not needed, of another type or shape than needed, or not finite; empty if none is.

    needed: may be without values, on the device `meta`.
    """
    for name in sorted({*tensors, *needed}):
        if name not in tensors or name not in needed:
            return f"{name}: {'is missing' if name in needed else 'is not needed'}"
        have, need = tensors[name], needed[name]
        if (have.dtype, have.shape) != (need.dtype, need.shape):
            return f"{name}: {have.dtype} of {list(have.shape)} instead of {need.dtype} of {list(need.shape)}"
        if not have.isfinite().all():
            return f"{name}: holds values that are not finite"
    return ""


def content_hash(header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of a header without its hash, and of all tensors with their names, types and shapes."""
    digest = hashlib.sha256(json.dumps(dict(header), sort_keys=True).encode())
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {list(tensors[name].shape)}".encode())
        digest.update(tensors[name].contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
