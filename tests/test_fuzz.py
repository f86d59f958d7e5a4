"""Mutated files of every kind: an error of ours that names the file, or content that the file states."""

import re
import sys

import fuzz_networks
import fuzz_plans
import fuzz_pushes
import fuzz_tracks
import pytest
from fuzz_pool import OUTCOMES, Found, Kind, attack

KINDS = [*fuzz_plans.KINDS, *fuzz_pushes.KINDS, *fuzz_tracks.KINDS, *fuzz_networks.KINDS]
SHORT, LONG = 8, 1000


def row(kind: Kind, found: Found) -> str:
    counts = " ".join(f"{found.count[outcome]:6d}" for outcome in OUTCOMES)
    return f"{kind.name:28s} {found.count.total():5d} {counts}  slowest {found.slowest:.1f} s"


def check(kind: Kind, count: int, seed: int) -> None:
    found = attack(kind, count, seed)
    print(row(kind, found))
    assert not found.faults, "\n".join(f"{index}: {outcome}: {what}" for index, (outcome, what) in found.faults.items())


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_mutated_files_are_refused_or_read_as_they_are(kind: Kind) -> None:
    check(kind, SHORT, 0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_thousand_mutated_files_are_refused_or_read_as_they_are(kind: Kind) -> None:
    check(kind, LONG, 1)


if __name__ == "__main__":
    count, chosen = int(sys.argv[1]), sys.argv[2:]
    print(f"{'':28s}       {', '.join(OUTCOMES)}")
    for kind in KINDS:
        if not chosen or kind.name in chosen:
            found = attack(kind, count, 1)
            print(row(kind, found), flush=True)
            shown: dict[str, int] = {}
            for index, (outcome, what) in found.faults.items():
                lines = [re.sub(r"/tmp/\w+|'.*'|\d+", "", line) for line in what.strip().splitlines()] or [""]
                key = outcome + lines[-1][:40]
                shown[key] = shown.get(key, 0) + 1
                if shown[key] == 1:
                    print(f"  {index} {outcome}: {what.strip()[-700:]}", flush=True)
            for key, times in shown.items():
                if times > 1:
                    print(f"  {times} times {key}")
