"""The wheels, in a new environment outside the source tree and without a network; the page on how to install."""

import re
import tarfile
import zipfile
from pathlib import Path

import pytest
from fresh_environment import ROOT, FreshEnvironment, build, wheel_metadata

pytestmark = pytest.mark.slow
PAGE = (ROOT / "docs" / "install.md").read_text()
SECTIONS = dict(re.findall(r"^## ([^\n]*)\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S))
REPOSITORY = "https://github.com/pushgraph/pushgraph"
ABSENT = "for name in {names!r}:\n    assert importlib.util.find_spec(name) is None, name"


@pytest.fixture(scope="module")
def wheels(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheels")
    build(folder)
    return folder


@pytest.fixture(scope="module")
def environment(wheels, tmp_path_factory) -> FreshEnvironment:
    made = FreshEnvironment(tmp_path_factory.mktemp("fresh"), wheels)
    made.offer(["pushgraph"])
    return made


def test_the_wheels_hold_what_they_should(wheels: Path) -> None:
    (wheel,) = wheels.glob("pushgraph-*.whl")
    (other,) = wheels.glob("pushgraph_baselines-*.whl")
    assert wheel.stat().st_size < 2_000_000
    weights = {archive: set() for archive in (wheel, other)}
    for archive, names in weights.items():
        with zipfile.ZipFile(archive) as content:
            names |= {Path(name).stem for name in content.namelist() if name.endswith(".safetensors")}
    assert weights[wheel] >= {"contact", "belief", "spread", "lever_up"}
    assert weights[other] >= {"propnet", "paper_recipe", "lever_up_propnet"}
    assert not weights[wheel] & weights[other]
    with zipfile.ZipFile(wheel) as content:
        names = set(content.namelist())
    assert names >= {f"pushgraph/{name}" for name in ("py.typed", "__init__.pyi", "scenes/demo.json")}
    assert not [name for name in names if not name.startswith(("pushgraph/", "pushgraph-"))]


def test_the_sdist_holds_what_it_is_built_and_tested_from(wheels: Path) -> None:
    (sdist,) = wheels.glob("*.tar.gz")
    with tarfile.open(sdist) as content:
        names = {name.split("/", 1)[1] for name in content.getnames()}
    assert names >= {
        "LICENSE",
        "README.md",
        "CITATION.cff",
        "constraints.txt",
        "tests/test_install.py",
        "docs/install.md",
    }
    assert not [name for name in names if name.startswith((".venv", ".git/", "baselines", "demo"))]


def test_links_of_the_readme_lead_somewhere_from_elsewhere(wheels: Path) -> None:
    said = wheel_metadata(wheels, "pushgraph").metadata
    links = re.findall(r"(!?)\[[^\]]*\]\(([^)]+)\)", said.get_payload())
    assert len(links) > 10
    for image, link in links:
        place = "https://raw.githubusercontent.com/pushgraph/pushgraph/main/" if image else f"{REPOSITORY}/blob/main/"
        assert link.startswith((place, "https://arxiv.org/")), link
        assert link.startswith("https://arxiv.org/") or (ROOT / link.removeprefix(place).split("#")[0]).exists(), link


def test_what_is_not_asked_for_is_missing_in_a_new_environment(wheels: Path, tmp_path: Path) -> None:
    empty = FreshEnvironment(tmp_path / "empty", wheels)
    failed = empty.run("pip install pushgraph", tmp_path)
    assert failed.returncode == 1
    assert "No matching distribution found for" in failed.stderr


@pytest.mark.timeout(900)
@pytest.mark.parametrize("title", SECTIONS)
def test_the_page_s_commands_run_as_printed(title: str, environment: FreshEnvironment, tmp_path: Path) -> None:
    section = SECTIONS[title]
    if title == "From source" and not (ROOT / ".git").exists():
        pytest.skip("no repository to clone")
    wanted = [*re.findall(r"pushgraph(\[[\w,]+\])", section), *re.findall(r"'\.(\[[\w,]+\])'", section)]
    environment.offer([f"pushgraph{extras}" for extras in wanted])
    environment.offer(["hatchling", "hatch-fancy-pypi-readme", "editables"] * (title == "From source"))
    environment.run("pip uninstall --yes pushgraph pushgraph-baselines", tmp_path)
    blocks = re.findall(r"```(console|python)\n(.*?)```", section, re.S)
    assert blocks
    for kind, block in blocks:
        script = block if kind == "python" else "\n".join(re.findall(r"^\$ (.*)$", block, re.M))
        # Only our own wheel can be downloaded here, and the repository is this one.
        done = environment.run(
            "python - <<'END'\n" + script + "END" if kind == "python" else script,
            tmp_path,
            PIP_NO_DEPS="1" if "pip download" in script else "0",
            GIT_CONFIG_COUNT="1",
            GIT_CONFIG_KEY_0=f"url.{ROOT}.insteadOf",
            GIT_CONFIG_VALUE_0=REPOSITORY,
        )
        assert done.returncode == 0, f"{script}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    CHECKS.get(title, lambda *_: None)(environment, tmp_path)


def check_prediction_alone(environment: FreshEnvironment, folder: Path) -> None:
    """Nothing else is there, and a command that needs it says so."""
    names = ("mujoco", "matplotlib", "PIL", "viser", "ray", "scipy", "gymnasium", "pushgraph_baselines")
    absent = environment.run(f"python - <<'END'\nimport importlib.util\n{ABSENT.format(names=names)}\nEND", folder)
    assert absent.returncode == 0, absent.stderr
    assert {path.name for path in (folder / "predicted").iterdir()} == {"track.h5", "track.csv"}
    for command, extra in {"simulate demo": "sim", "predict demo --model propnet": "baselines"}.items():
        refused = environment.run(f"pushgraph {command}", folder)
        assert refused.returncode == 1
        assert f"pip install 'pushgraph[{extra}]'" in refused.stderr


CHECKS = {"Prediction alone": check_prediction_alone}
