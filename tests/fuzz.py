"""Mutations of files, drawn from a seed: bytes of any file, and the structure of JSON, CSV, HDF5 and safetensors."""

import copy
import json
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import h5py
import numpy as np
import torch
from safetensors.torch import load, save

from pushgraph.tensor_file import content_hash

Mutation = Callable[[bytes, Random], bytes]
BEYOND = "number beyond floats"
"""Stands for 1e400 until the JSON is text."""
VALUES = (
    float("nan"), float("inf"), -float("inf"), BEYOND, -1, 0, 1e-300, 1e300, 10**30, 10**400, 2**63, 0.5, True, None,
    "text", "", "1.0", "nan", "\x00", "\ud800", "x" * 100_000, [], {}, [1, 2], [[]], [None], {"a": 1}, [0.5] * 5000,
)  # fmt: skip
CELLS = (
    "", " ", "nan", "inf", "-inf", "1e400", "-1e9", "1e300", "0x10", "1_000", "١٢", " 1 ", "+1", "1,5", "1.5", "-1",
    "7", '"', "'", '"a\nb"', "text", "x" * 200_000, "\x00", "1e5", "None", "0.1.2", "9" * 5000, "1" * 400, "\ufeff",
    "robot",
)  # fmt: skip


def of_bytes(content: bytes, rng: Random) -> bytes:
    """One to three of: bits turned, bytes replaced, put in, left out, doubled, swapped; or the file cut off."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 3])):
        if not data:
            break
        at, length = rng.randrange(len(data)), rng.randrange(1, 64)
        kind = rng.randrange(9)
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at : at + length] = rng.randbytes(length)
        elif kind == 2:
            del data[at : at + length]
        elif kind == 3:
            data[at:at] = data[at : at + length]
        elif kind == 4:
            data[at:at] = rng.randbytes(length)
        elif kind == 5:
            data[at : at + 8] = rng.choice([b"\xff", b"\x00", b"\x7f"]) * 8
        elif kind == 6:
            token = rng.choice([b"1e300", b"nan", b"-1e6", b"1000000", b"inf", b'"', b"\n", b",,", b"\x00", b"[", b"}"])
            data[at : at + len(token)] = token
        elif kind == 7:
            other = rng.randrange(len(data))
            first, second = bytes(data[at : at + length]), bytes(data[other : other + length])
            data[at : at + length], data[other : other + length] = second, first
        else:
            del data[at:]
    return bytes(data)


def change_tree(root: Any, rng: Random) -> Any:
    """Values of other types and sizes, keys and items missing, doubled, exchanged or unknown, deep nesting."""
    root = copy.deepcopy(root)
    for _ in range(rng.choice([1, 1, 2])):
        places = list(_places(root))
        parent, key = rng.choice(places) if places else (None, None)
        kind = rng.randrange(12)
        if parent is None or (kind == 0 and rng.random() < 0.2):
            return copy.deepcopy(rng.choice(VALUES))
        old = parent[key]
        if kind <= 4:
            parent[key] = copy.deepcopy(rng.choice(VALUES))
        elif kind == 5:
            del parent[key]
        elif kind == 6 and isinstance(parent, dict):
            parent[rng.choice(["unknown", "", key + "s", key.upper(), " " + key])] = old
        elif kind == 7 and isinstance(parent, list):
            parent.insert(key, copy.deepcopy(old))
        elif kind == 8:
            other = rng.choice(list(parent) if isinstance(parent, dict) else range(len(parent)))
            parent[key], parent[other] = parent[other], parent[key]
        elif kind == 9 and isinstance(old, int | float) and not isinstance(old, bool) and abs(old) < 1e300:
            parent[key] = rng.choice([str(old), -old, old * 1000, old + 1, old / 3, int(old), [old]])
        elif kind == 10:
            parent[key] = {"value": old} if rng.random() < 0.5 else [old]
        elif kind == 11 and isinstance(old, list) and old:
            parent[key] = rng.choice([old * 2, old[:-1], old[::-1], old[:1] * 3000])
    return root


def _places(value: Any) -> Any:
    """Every (container, key) below a value."""
    for key, child in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield value, key
        yield from _places(child)


def as_json(tree: Any) -> str:
    """Text of a tree."""
    return json.dumps(tree).replace(f'"{BEYOND}"', "1e400")


def of_json(reseal: Callable[[Any], Any] = lambda tree: tree) -> Mutation:
    """Of the tree, half of them resealed, and of its text: encodings, keys that stand twice, nesting without end."""

    def mutation(content: bytes, rng: Random) -> bytes:
        tree, kind = json.loads(content), rng.randrange(10)
        if kind > 3:
            changed = change_tree(tree, rng)
            return as_json(reseal(changed) if rng.random() < 0.5 else changed).encode("utf-8", "surrogatepass")
        text = as_json(tree)
        if kind == 0:
            encoding = rng.choice(["utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp037"])
            return text.encode(encoding)
        if kind == 1:
            deep = rng.choice([50, 1000, 100_000])
            bracket = rng.choice(["[]", '{"a":}'])
            nested = "[" * deep + "]" * deep if bracket == "[]" else '{"a":' * deep + "1" + "}" * deep
            places = list(_places(tree))
            if not places or rng.random() < 0.2:
                return nested.encode()
            parent, key = rng.choice(places)
            parent[key] = "@deep@"
            return as_json(tree).replace('"@deep@"', nested).encode()
        if kind == 2 and isinstance(tree, dict) and tree:
            key = rng.choice(list(tree))
            return (text[:-1] + f", {json.dumps(key)}: {as_json(change_tree(tree[key], rng))}}}").encode()
        return (text + rng.choice(["}", "{}", "\x00", " x", text])).encode()

    return mutation


def of_csv(content: bytes, rng: Random) -> bytes:
    """Cells, rows and columns replaced, missing, doubled or exchanged; other encodings."""
    rows = [line.split(",") for line in content.decode().splitlines()]
    for _ in range(rng.choice([1, 1, 2])):
        kind, line = rng.randrange(14), rng.randrange(len(rows))
        cell = rng.randrange(len(rows[line])) if rows[line] else 0
        if kind <= 4:
            rows[line][cell : cell + 1] = [rng.choice(CELLS)]
        elif kind == 5:
            del rows[line][cell : cell + 1]
        elif kind == 6:
            rows[line].insert(cell, rng.choice(CELLS))
        elif kind == 7:
            rows.insert(line, list(rows[line]))
        elif kind == 8 and len(rows) > 1:
            del rows[line]
        elif kind == 9:
            other = rng.randrange(len(rows))
            rows[line], rows[other] = rows[other], rows[line]
        elif kind == 10 and rows[0]:
            a, b = rng.randrange(len(rows[0])), rng.randrange(len(rows[0]))
            for row in rows[: rng.choice([1, len(rows)])]:
                if max(a, b) < len(row):
                    row[a], row[b] = row[b], row[a]
        elif kind == 11 and rows[0]:
            rows[0][rng.randrange(len(rows[0]))] = rng.choice([*rows[0], "unknown", ""])
        elif kind == 12:
            rows[line:line] = [[]] * rng.choice([1, 3])
        else:
            rows = rows[: rng.choice([1, 2])]
    text = rng.choice(["\n", "\n", "\n", "\r\n", "\r"]).join(",".join(row) for row in rows)
    return text.encode(rng.choice(["utf-8"] * 8 + ["utf-16", "utf-8-sig", "utf-32"]), "surrogatepass")


def of_toml(content: bytes, rng: Random) -> bytes:
    """Values of other kinds, keys that are unknown or stand twice, tables, nesting, other encodings."""
    lines = content.decode().splitlines()
    values = ["1", "0", "-1", "1e400", "nan", "inf", "true", '""', '"x"', "[]", "[1]", '["a", 1]', "{}", "{a = 1}"]
    values += ["1979-05-27", "07:32:00", "9" * 5000, "0x10", "1_000", '"\\ud800"', "-0.0", "[" * 9000, ""]
    for _ in range(rng.choice([1, 1, 2])):
        kind, place = rng.randrange(8), rng.randrange(1, len(lines))
        key, _, value = lines[place].partition(" = ")
        if kind <= 2:
            lines[place] = f"{key} = {rng.choice(values)}"
        elif kind == 3:
            del lines[place]
        elif kind == 4:
            new = [lines[place], f"[{key}]", f"{key}.a = 1", "a.b.c" * 2000 + " = 1", "[[x]]"]
            lines.insert(place, rng.choice(new))
        elif kind == 5:
            near = key[:-1] + rng.choice(["", "_", key[-1] * 2])
            lines[place] = f"{rng.choice([near, '', key.upper(), repr(key)])} = {value}"
        elif kind == 6:
            lines[place] = f"{key} = {rng.choice(lines).partition(' = ')[2]}"
        else:
            lines[place] += rng.choice([" x", " # é", "\x00", "\r", "#" * 2**17])
    return "\n".join(lines).encode(rng.choice(["utf-8"] * 8 + ["utf-16", "utf-8-sig"]), "surrogatepass")


def of_svg(content: bytes, rng: Random) -> bytes:
    """Path data, transforms, elements of other kinds, references to themselves and elsewhere, entities, nesting."""
    text = content.decode()
    start, end = text.index(' d="') + 4, text.index('"', text.index(' d="') + 4)
    for _ in range(rng.choice([1, 1, 2])):
        kind = rng.randrange(8)
        if kind <= 2:
            tokens = text[start:end].split()
            place = rng.randrange(len(tokens))
            tokens[place : place + rng.choice([0, 1])] = [rng.choice([*CELLS, *"MLHVCSQTAZmlhvcsqtaz", "@", "1e-400"])]
            text = text[:start] + " ".join(tokens).replace('"', "&quot;").replace("\x00", "?") + text[end:]
            end = text.index('"', start)
        elif kind == 3:
            inner = rng.choice(
                ["scale(0)", "rotate(x)", "matrix(1 2)", "translate(1e308)", "scale(1e300)", "skewX(90)", "("]
            )
            return text.replace("translate(10 5)", inner).encode()
        elif kind == 4:
            box = rng.choice(["0 0 0 0", "0 0 -5 5", "x", "", "0 0 1e400 1", "nan nan nan nan", "0 0 1e-300 1"])
            return text.replace("0 0 200 200", box).encode()
        elif kind == 5:
            other = rng.choice(
                [
                    '<use href="#part"/>',
                    '<use id="part" href="#part"/>',
                    '<image href="/etc/passwd"/>',
                    "<text>x</text>",
                    '<rect width="1e9" height="5"/>',
                    '<circle r="-5"/>',
                    '<polygon points="0,0 1"/>',
                    "<g>" * 5000,
                    '<ellipse rx="40" ry="1e-9"/>',
                    '<polyline points="0,0 5,0 5,5 0,0"/>',
                    "<style>path{d:none}</style>",
                    "<path/>",
                    '<path d="M0 0' + " l1 1" * 50_000 + ' Z"/>',
                    "<g>" * 2000 + "</g>" * 2000,
                ]
            )
            return text.replace("</g>", other + "</g>").encode()
        elif kind == 6:
            laughs = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 9))
            entity = rng.choice(['<!ENTITY a8 SYSTEM "file:///etc/passwd">', f'<!ENTITY a0 "0 ">{laughs}'])
            return f"<!DOCTYPE svg [{entity}]>{text[:end]}&a8;{text[end:]}".encode()
        else:
            return text.encode(rng.choice(["utf-16", "utf-32", "utf-8-sig"]))
    return text.encode("utf-8", "surrogatepass")


def of_hdf5(reseal: Callable[[bytes], bytes] = lambda content: content) -> Mutation:
    """Attributes, and arrays of other kinds, shapes, sizes and places; half of them resealed."""

    def mutation(content: bytes, rng: Random) -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "mutated.h5"
            path.write_bytes(content)
            with h5py.File(path, "r+") as file:
                for _ in range(rng.choice([1, 1, 2])):
                    _change_attribute(file, rng) if rng.random() < 0.3 and file.attrs else _change_array(file, rng)
            changed = path.read_bytes()
        return reseal(changed) if rng.random() < 0.5 else changed

    return mutation


def _change_attribute(file: h5py.File, rng: Random) -> None:
    name = rng.choice(list(file.attrs))
    old = file.attrs[name]
    del file.attrs[name]
    kind = rng.randrange(5)
    if kind == 0:
        return
    if kind == 1 and isinstance(old, str):
        changed = of_bytes(old.encode("utf-8", "surrogateescape"), rng).replace(b"\x00", b"?")
        file.attrs[name] = np.bytes_(changed) if rng.random() < 0.5 else changed.decode(errors="replace")
    elif kind == 2:
        file.attrs[name] = h5py.Empty("f8")
    else:
        options = (1, -1, 0, 1.5, np.nan, 2**62, "2", "", b"\xff\xfe", [1, 2], ["a", "b"], True, 1 + 2j, 10**9)
        file.attrs[name] = rng.choice(options)


def _change_array(file: h5py.File, rng: Random) -> None:
    found: list[str] = []

    def visit(name: str, one: Any) -> None:
        if isinstance(one, h5py.Dataset) and (one.size or 0) < 10**6 and not one.is_virtual and not one.external:
            found.append(name)

    file.visititems(visit)
    if not found:
        return
    name = rng.choice(found)
    old = file[name][()]
    array = np.asarray(old)
    kind = rng.randrange(16)
    if kind == 0 and array.size and array.dtype.kind in "fiu":
        flat = array.reshape(-1).copy()
        with np.errstate(over="ignore"):
            flat[rng.randrange(flat.size)] = rng.choice(
                [1, 0, 100] if array.dtype.kind != "f" else [np.nan, np.inf, 1e30, -1.0, 0.0, 0.123]
            )
        file[name][...] = flat.reshape(array.shape)
        return
    del file[name]
    if kind == 1:
        return
    if kind == 2:
        other = rng.choice(["i1", "u8", "c16", "f2", "?", ">f8", ">i4", "f4", "f8", "i8", "S3", "i2"])
        try:
            with np.errstate(invalid="ignore"):  # NaN as a whole number is one more damage
                file[name] = array.astype(other)
        except (TypeError, ValueError):
            file[name] = np.zeros(array.shape, other)
    elif kind == 3:
        file[name] = rng.choice([h5py.Empty("f8"), 1.0, "text", np.zeros(0), np.zeros((0, 3)), [b"a", b"b"]])
    elif kind == 4:
        shapes = (
            [array[:-1], array[..., None], array.T, array.reshape(-1), np.concatenate([array, array])]
            if (array.ndim)
            else [array[None]]
        )
        file[name] = rng.choice(shapes)
    elif kind == 5:
        file.create_dataset(name, (10 ** rng.choice([6, 9, 12, 15]), *array.shape[1:]), array.dtype, chunks=True)
    elif kind == 6:
        file.create_dataset(name, (10**7, *array.shape[1:]), array.dtype, chunks=True, compression="gzip")
    elif kind == 7:
        place = rng.choice(["/dev/zero", "/etc/passwd", "missing.raw"])
        kept = "f8" if array.dtype.kind not in "fiub" else array.dtype
        file.create_dataset(name, array.shape or (1,), kept, external=[(place, 0, h5py.h5f.UNLIMITED)])
    elif kind == 8 and array.dtype.kind in "fiub":
        layout = h5py.VirtualLayout(shape=array.shape or (1,), dtype=array.dtype)
        layout[:] = h5py.VirtualSource(rng.choice([".", "other.h5"]), name, shape=array.shape or (1,))
        file.create_virtual_dataset(name, layout)
    elif kind == 9:
        file[name] = rng.choice([h5py.SoftLink("/" + name), h5py.SoftLink("/"), h5py.ExternalLink("o.h5", "/" + name)])
    elif kind == 10:
        file.create_group(name)
    elif kind == 11:
        file[name] = np.zeros(array.shape or (1,), [("a", "i4"), ("b", "f4")])
    elif kind == 12:
        packed = {"chunks": True, "compression": "gzip"} if array.ndim and array.size else {}
        file.create_dataset(name, data=old, **packed)
    elif kind == 13 and array.ndim == 1:
        file.create_dataset(name, data=[b"\xff\xfe"] * len(array), dtype="S2")
    elif kind == 14:
        file[name] = old
        file[f"{name} {rng.randrange(10**6)}"] = np.arange(3)
    else:
        file[name] = array[::-1] if array.ndim else array


def of_tensors(content: bytes, rng: Random) -> bytes:
    """Headers and tensors of other types, shapes and values, most of them with the hash made anew; raw headers."""
    length = struct.unpack("<Q", content[:8])[0]
    raw = json.loads(content[8 : 8 + length])
    if rng.random() < 0.2:
        changed = as_json(change_tree(raw, rng)).encode("utf-8", "surrogatepass")
        size = len(changed) if rng.random() < 0.8 else rng.choice([0, 2**20, 2**40, 2**63, len(changed) + 1])
        return struct.pack("<Q", size) + changed + content[8 + length :]
    header, tensors = json.loads(raw["__metadata__"]["pushgraph"]), load(content)
    for _ in range(rng.choice([1, 1, 2])):
        if rng.random() < 0.5:
            header = change_tree(header, rng)
        elif tensors:
            _change_tensor(tensors, rng)
    if isinstance(header, dict) and "hash" in header and rng.random() < 0.8:
        del header["hash"]
        header["hash"] = content_hash(header, tensors)
    return save(tensors, {"pushgraph": as_json(header)})


def _change_tensor(tensors: dict[str, torch.Tensor], rng: Random) -> None:
    name = rng.choice(list(tensors))
    one = tensors[name]
    kind = rng.randrange(8)
    if kind <= 2:
        types = (torch.int8, torch.uint8, torch.int64, torch.bool, torch.float16, torch.bfloat16, torch.float64)
        wider = (torch.complex64, torch.float8_e4m3fn, torch.float8_e5m2)
        tensors[name] = one.to(rng.choice(types + wider))
    elif kind == 3:
        tensors[name] = one.double().fill_(rng.choice([float("nan"), float("inf"), 1e38, 0.0, -1.0])).to(one.dtype)
    elif kind == 4:
        shapes = [
            one.reshape(-1),
            one[None],
            one.reshape(-1)[:1].reshape(()),
            one.reshape(-1)[:0],
            one.mT if (one.dim() > 1) else one,
        ]
        tensors[name] = rng.choice(shapes).clone().contiguous()
    elif kind == 5:
        del tensors[name]
    elif kind == 6:
        tensors[rng.choice(["unknown", name + "2", "", name.replace(".", "")])] = one.clone()
    else:
        other = rng.choice(list(tensors))
        tensors[name], tensors[other] = tensors[other].clone(), one.clone()
