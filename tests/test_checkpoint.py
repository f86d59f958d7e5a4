"""Checkpoints: what is written is what is read, and anything else is refused with its reason."""

import json
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint, shipped
from pushgraph.errors import CheckpointError
from pushgraph.graph import contact_graph
from pushgraph.network.dynamics import DYNAMICS
from pushgraph.tensor_file import content_hash

CONFIG = {"hidden": 8, "steps": 2}


@pytest.fixture(params=["contact", "propnet"])
def saved(request, tmp_path) -> tuple[Checkpoint, Path]:
    torch.manual_seed(3)
    made = Checkpoint(
        request.param, CONFIG, DYNAMICS[request.param](**CONFIG), {"samples": 5, "curve": [{"loss": 0.5}]}
    )
    save_checkpoint(made, tmp_path / "a.safetensors")
    return made, tmp_path / "a.safetensors"


def test_what_is_written_is_what_is_read(saved) -> None:
    made, path = saved
    read = load_checkpoint(path)
    assert (read.kind, read.config, read.record) == (made.kind, made.config, made.record)
    for name, values in made.network.state_dict().items():
        assert torch.equal(values, read.network.state_dict()[name])
    assert not read.network.training


def rewrite(path: Path, edit, rehash: bool = True) -> None:
    with safe_open(path, "pt") as file:
        header = json.loads(file.metadata()["pushgraph"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    edit(header, tensors)
    if rehash:
        header.pop("hash")
        header["hash"] = content_hash(header, tensors)
    save_file(tensors, path, {"pushgraph": json.dumps(header)})


@pytest.mark.parametrize(
    ("edit", "rehash", "says"),
    [
        (lambda h, t: h.update(version=2), True, "version 2; this pushgraph reads 1"),
        (lambda h, t: h.update(format="other"), True, "no checkpoint of pushgraph"),
        (lambda h, t: h["record"].update(samples=10**9), False, "does not match its hash"),
        (lambda h, t: next(iter(t.values())).add_(1e-3), False, "does not match its hash"),
        (
            lambda h, t: h.update(kind="magic"),
            True,
            "no network 'magic'; valid: propnet, contact, image, belief, paper_recipe, spread",
        ),
        (lambda h, t: h["schema"]["edge_features"].pop(), True, r"other features \(edge_features\)"),
        (lambda h, t: h["config"].update(hidden=9), True, "do not fit its config"),
        (lambda h, t: t.pop(next(iter(t))), True, "do not fit its config"),
        (lambda h, t: next(iter(t.values())).fill_(float("nan")), True, "not finite"),
    ],
)
def test_a_checkpoint_that_is_not_what_it_says_is_refused(saved, edit, rehash, says) -> None:
    _, path = saved
    rewrite(path, edit, rehash)
    with pytest.raises(CheckpointError, match=says):
        load_checkpoint(path)


def test_constants_of_features_are_part_of_a_checkpoint(saved, monkeypatch) -> None:
    made, path = saved
    if made.kind == "contact":
        monkeypatch.setitem(contact_graph.CONSTANTS, "twins", 0.01)
        with pytest.raises(CheckpointError, match=r"other features \(constants\)"):
            load_checkpoint(path)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.999])
def test_truncated_files_are_refused(saved, share) -> None:
    _, path = saved
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(CheckpointError, match="truncated"):
        load_checkpoint(path)


def test_missing_files_and_unknown_names_are_told_apart(tmp_path) -> None:
    with pytest.raises(CheckpointError, match="no such file"):
        load_checkpoint(tmp_path / "none.safetensors")
    with pytest.raises(CheckpointError, match="no shipped checkpoint 'best'; valid: "):
        shipped("best")


def test_a_failed_write_leaves_the_old_file(saved, monkeypatch) -> None:
    made, path = saved
    before = path.read_bytes()
    full = OSError(28, "No space left on device")
    monkeypatch.setattr("pushgraph.tensor_file.save", lambda *_: (_ for _ in ()).throw(full))
    with pytest.raises(Exception, match="No space left"):
        save_checkpoint(made, path)
    assert path.read_bytes() == before
