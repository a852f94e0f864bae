# SPDX-License-Identifier: LGPL-3.0-or-later
"""The documentation builds without a warning, is whole, and what it says to type can be typed.

Building needs Sphinx and a minute or two: `XPER_FX_DOCS=1 ./fenicsx pytest -m docs`. Without
XPER_FX_DOCS, or `-m docs`, it is left out, and all else is checked.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import os
import pkgutil
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from outside_law import LinearSoftening

import xper_fx

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="the package is not in its checkout")

# Pages that people write; the others are made at each build.
MADE = ("gallery.md", "tests.md", "demos/", "api/generated/", "_build/")
PAGES = [
    path
    for path in sorted(DOCS.rglob("*.md"))
    if not str(path.relative_to(DOCS)).startswith(MADE) and path.name != "hard_cases.md"
]
WITH_CODE = [path for path in PAGES if "```python" in path.read_text()]
NAMES = [str(path.relative_to(DOCS)) for path in WITH_CODE]


@pytest.fixture
def gallery(monkeypatch):
    """The module docs/gallery.py."""
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module("gallery")


# -- what is built


@pytest.fixture(scope="module")
def built(request, tmp_path_factory):
    """The HTML, built from a copy; warnings are errors."""
    if not os.environ.get("XPER_FX_DOCS") and "docs" not in request.config.option.markexpr:
        pytest.skip("the documentation is built with XPER_FX_DOCS=1 or -m docs")
    for name in ("sphinx", "myst_parser", "jupytext", "furo"):
        if find_spec(name) is None:
            pytest.skip(
                f"{name} is missing: XPER_FX_DOCS=1 ./fenicsx pytest, or pip install .[docs]"
            )
    folder = tmp_path_factory.mktemp("documentation")
    for name in ("README.md", "CHANGELOG.md", "demos", "tests", "xper_fx"):
        (folder / name).symlink_to(ROOT / name)
    left = shutil.ignore_patterns("_build", "generated", "demos", "gallery.md", "tests.md")
    shutil.copytree(DOCS, folder / "docs", ignore=left)
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    run = subprocess.run(
        [*command, folder / "docs", folder / "html"], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    return folder / "html"


@pytest.mark.docs
def test_every_demo_has_a_page_with_its_code_and_figures(built, gallery):
    for demo in sorted((ROOT / "demos").glob("*.py")):
        page = (built / "demos" / f"{demo.stem}.html").read_text()
        assert f"demos/{demo.name}" in page and "argparse" in page
        figures = [file for f in gallery.GALLERY if f.demo == demo.stem for file in f.files]
        assert figures and all(f"_images/{file}" in page for file in figures)


@pytest.mark.docs
def test_every_public_module_is_in_the_reference(built):
    modules = [m.name for m in pkgutil.walk_packages(xper_fx.__path__, "xper_fx.")]
    public = [name for name in modules if "._" not in name]
    assert len(public) > 100
    for name in public:
        page = (built / "api" / "generated" / f"{name}.html").read_text()
        tree = ast.parse(Path(importlib.util.find_spec(name).origin).read_text())
        named = [
            node.name
            for node in tree.body
            if isinstance(node, ast.ClassDef | ast.FunctionDef)
            and ast.get_docstring(node)
            # an instruction of Numba's, which is no function of Python's
            and "intrinsic" not in map(ast.unparse, node.decorator_list)
        ]
        missing = [n for n in named if n[0] != "_" and f'id="{name}.{n}"' not in page]
        assert not missing, f"{name} lacks {missing}"


@pytest.mark.docs
def test_images_and_links_within_lead_somewhere(built):
    """No image and no page that is not there, and no markup left in the text."""
    pages = [path for path in built.rglob("*.html") if "_modules" not in path.parts]
    assert len(pages) > 150
    for page in pages:
        text = page.read_text()
        links = re.findall(r'<img[^>]*src="([^"]+)"', text)
        links += re.findall(r'<a [^>]*href="([^"#?]+)', text)
        for link in (link for link in links if ":" not in link):
            assert (page.parent / link).exists(), f"{page.name}: {link}"
        assert "system-message" not in text and "problematic" not in text, page
        assert "{doc}" not in text and "{py:" not in text, page


# -- figures


def test_every_figure_is_in_the_gallery_and_on_a_page(gallery):
    drawn = [file for figures in gallery.GALLERY for file in figures.files]
    there = [path.name for path in DOCS.iterdir() if path.suffix in (".png", ".gif")]
    assert sorted(drawn) == sorted(there)
    text = "".join(path.read_text() for path in PAGES) + (ROOT / "README.md").read_text()
    assert all(file in text for file in drawn)


def test_figures_are_drawn_where_the_gallery_looks(gallery, tmp_path, monkeypatch):
    """The command as it stands, but for a script that stands in for the demo."""
    (tmp_path / "draw.py").write_text(
        "import pathlib, sys\n"
        "out = pathlib.Path(sys.argv[sys.argv.index('--out') + 1])\n"
        "(out / 'a.png').write_text('drawn')\n"
        "(out / 'a.gif').write_text('filmed')\n"
    )
    monkeypatch.setattr(gallery, "ROOT", tmp_path)
    drawn = {"b": "a.png", "c": "a.gif"}
    figures = gallery.Figures("draw.py", "--out {out}", drawn, ("A figure", "A film"), "seconds")
    gallery.draw(figures, tmp_path / "results", tmp_path)
    assert (tmp_path / "b.png").read_text() == "drawn"
    assert (tmp_path / "c.gif").read_text() == "filmed"
    assert figures.command("results/x") == "./fenicsx python3 draw.py --out results/x"


# -- code


def blocks(page: Path) -> list[str]:
    """The Python code on a page."""
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_CODE, ids=NAMES)
def test_code_on_a_page_runs(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict = {"__name__": "__main__"}
    quicker = QUICKER.get(page, {})
    assert all(text in page.read_text() for text in quicker)
    for number, code in enumerate(blocks(page)):
        for written, run in quicker.items():
            code = code.replace(written, run)
        exec(compile(code, f"{page.name}, block {number}", "exec"), names)
    if page in CHECKS:
        CHECKS[page](names, capsys.readouterr().out)
    if page.parent.name == "tutorials":
        drawn = {path.name for path in tmp_path.iterdir() if path.suffix in (".png", ".gif")}
        assert drawn == set(re.findall(r"\{figure\} (\S+)", page.read_text()))
        assert all((page.parent / name).stat().st_size > 10_000 for name in drawn)
        lines = [line for block in blocks(page) for line in block.splitlines() if line.strip()]
        assert 30 <= len(lines) <= 60


def check_a_first_run(names, printed):
    """E' eps with the artificial compliance of the bonds, -2 % at 5 um: 108 GPa * 0.2 %."""
    time, stress, closure = (float(x) for x in printed.splitlines()[0].split())
    assert time >= 5e-8
    assert abs(stress - 2.1e8) < 0.1e8
    assert abs(closure) < 1e-10 * names["step"].energies["external_work"]
    assert "cohesive zone with friction" in printed


def check_the_periodic_cell(names, printed):
    """524.7 MPa at 1 %, nothing sideways; discs that bear what is asked for, and flow."""
    stress = names["simulation"].macroscopic.stress
    np.testing.assert_allclose(stress[0, 0], 524.7e6, rtol=1e-3)
    assert abs(stress[1, 1]) < 1e-6 * stress[0, 0]
    assert 0.55 < np.linalg.det(names["packing"].macroscopic.gradient) < 0.65
    stress = names["s"]
    np.testing.assert_allclose(stress[1, 1], -1.0, rtol=0.1)
    assert 0.2 < -stress[0, 1] / stress[1, 1] < 0.5


def check_the_contact_problem(names, printed):
    """Both corners slide to the right, the front one carries more; momentum before and after."""
    reaction, velocity = names["result"].reaction, names["result"].velocity
    normal, tangential = reaction[::2], reaction[1::2]
    assert names["result"].converged
    np.testing.assert_allclose(tangential, 0.3 * normal, rtol=1e-8)
    np.testing.assert_allclose(normal.sum(), 0.1, rtol=1e-8)
    np.testing.assert_allclose(velocity, [0.0, -0.17, 0.0, -0.17], atol=1e-9)
    assert normal[1] > normal[0] > 0.0


def check_contacts(names, printed):
    """The disc rolls down the slope by g sin(slope) t^2 / 3; the block presses with its weight."""
    x, y, closure = (float(x) for x in re.sub(r"[\[\]]", " ", printed.splitlines()[0]).split())
    np.testing.assert_allclose((2.0 * x - y) / 5**0.5, 9.81 / 5**0.5 * 0.5**2 / 3.0, rtol=1e-2)
    assert abs(closure) < 1e-10
    pressing = names["xf"].output.find_contact_forces(names["simulation"]).force[:, 1]
    assert pressing.sum() == pytest.approx(1000.0 * 9.81, rel=0.05)


def check_a_material_of_ones_own(names, printed):
    assert names["force"] == pytest.approx(names["exact"], rel=1e-9)


def check_bodies(names, printed):
    assert names["each_cell"].num_bodies == 64 and names["two_bodies"].num_bodies == 2


def check_the_cracked_plate(names, printed):
    """A straight crack through the ligament; the ledger closes, the crack costs what it must."""
    assert names["length"] == pytest.approx(15e-3, rel=1e-6)
    assert 1.0 < names["spent"] / names["needed"] < 1.25
    assert abs(names["step"].energies["closure"]) < 1e-2 * names["spent"]
    assert names["half_broken"] is not None


def check_the_cell_with_a_particle(names, printed):
    """524.7 MPa for the metal alone at 1 %; the particle makes it stiffer and stronger."""
    metal, composite = names["metal"], names["composite"]
    assert metal["stress"][-1] == pytest.approx(524.7e6, rel=1e-3)
    assert composite["strain"][-1] == pytest.approx(metal["strain"][-1])
    assert np.all(composite["stress"] > metal["stress"])
    assert np.abs(composite["closure"]).max() < 1e-2 * composite["external_work"][-1]


def check_the_grains(names, printed):
    """All at rest: floor and walls carry the weight."""
    assert len(names["frames"]) == 3
    assert names["carried"] == pytest.approx(names["weight"], rel=0.02)
    assert abs(names["step"].energies["closure"]) < 1e-2 * names["weight"]


def check_the_fibre(names, printed):
    """The interface breaks and the plate weakens; it is elastic before, with a stiffer fibre."""
    weak, perfect = names["debonding"], names["perfect"]
    assert 0.2 < names["debonded"] < 1.0
    assert weak["stress"].max() < 0.9 * perfect["stress"].max()
    slope = np.polyfit(perfect["strain"], perfect["stress"], 1)[0]
    assert 3e9 / (1.0 - 0.35**2) < slope < 5e9


def check_the_wall(names, printed):
    """It carries its weight, and falls below the angle of friction, at which it would slide."""
    found = names["found"]
    assert names["upright"].stands and names["carried"] == pytest.approx(names["weight"], rel=1e-4)
    assert 29.0 < found.stands < found.falls < np.degrees(np.arctan(0.6))
    assert 4 <= names["moving"].sum() < 20
    place = names["simulation"].rigid.state.position
    assert place[: len(names["wall"]), 0].max() > 2.5


def check_the_column(names, printed):
    """The run-out is that of the published law to 30 %; no grain was through a wall."""
    assert names["run_out"] == pytest.approx(names["published"], rel=0.3)
    assert names["film"].frames == 8
    assert names["place"][:, 0].max() < names["WIDTH"]


def check_the_output(names, printed):
    """The plate is whole: one fragment of its mass and sides, which a map shows."""
    found, folder = names["found"], Path(names["folder"])
    assert found.bodies.tolist() == [16] and "1 fragments" in printed
    assert found.mass == pytest.approx([1200.0 * 1e-6], rel=1e-12)
    assert found.lengths[0] == pytest.approx([1e-3, 1e-3], rel=1e-3)
    for name in ("fragments.csv", "sizes.png", "map.png"):
        assert (folder / name).stat().st_size > 100


# What pages run longer than the checks of them need: text of theirs, and what is run instead.
QUICKER = {
    DOCS / "guide/contact.md": {"0.01), (0.5, 1.0)": "0.01), (0.5, 0.5)", "step=1e-3": "step=2e-3"},
    DOCS / "guide/joints.md": {"end_time=3.0": "end_time=0.5"},
    DOCS / "guide/periodic.md": {"(8.0, 9.0)": "(6.0, 5.0)", "step=1e-4": "step=2e-4"},
    DOCS / "guide/slow_fracture.md": {"(200, 4)": "(100, 4)", "steps(2.0)": "steps(1.5)"},
    DOCS / "tutorials/blocks_and_grains.md": {
        "step=2e-3": "step=4e-3",
        "2.399": "1.599",
        "2.4": "1.6",
    },
    DOCS / "tutorials/granular_column.md": {
        "step=1e-3": "step=2e-3",
        "count=200": "count=100",
        "every=0.025": "every=0.1",
    },
    DOCS / "tutorials/periodic_cell.md": {"step=2e-4": "step=5e-4"},
    DOCS / "tutorials/masonry_wall.md": {"step=2e-3": "step=5e-3", "every=0.03": "every=0.3"},
}
CHECKS = {
    DOCS / "start.md": check_a_first_run,
    DOCS / "guide/periodic.md": check_the_periodic_cell,
    DOCS / "guide/friction_problem.md": check_the_contact_problem,
    DOCS / "guide/contact.md": check_contacts,
    DOCS / "guide/output.md": check_the_output,
    DOCS / "guide/scene.md": check_bodies,
    DOCS / "howto/own_material.md": check_a_material_of_ones_own,
    DOCS / "tutorials/cracked_plate.md": check_the_cracked_plate,
    DOCS / "tutorials/periodic_cell.md": check_the_cell_with_a_particle,
    DOCS / "tutorials/blocks_and_grains.md": check_the_grains,
    DOCS / "tutorials/gmsh_interface.md": check_the_fibre,
    DOCS / "tutorials/masonry_wall.md": check_the_wall,
    DOCS / "tutorials/granular_column.md": check_the_column,
}


def test_pages_import_the_door_alone():
    """`import xper_fx as xf` is all that code on pages, and demos, import of the package."""
    assert set(CHECKS) <= set(WITH_CODE)
    code = [block for page in WITH_CODE for block in blocks(page)]
    code += [demo.read_text() for demo in (ROOT / "demos").glob("*.py")]
    assert len(code) > 30
    for text in code:
        assert re.findall(r"^[ \t]*(?:from|import) xper_fx.*$", text, re.MULTILINE) in (
            [], ["import xper_fx as xf"]
        )  # fmt: skip


@pytest.fixture
def own_law(monkeypatch):
    """The module docs/howto/own_law.py."""
    monkeypatch.syspath_prepend(str(DOCS / "howto"))
    return importlib.import_module("own_law")


SOLVERS = [
    (7, {}), (200, {"theta": 1.0, "solver": "newton"}), (50, {"solver": "nlgs"}),
    (50, {"solver": "accelerated"}),
]  # fmt: skip


@pytest.mark.parametrize("which", ["curve", "kernels"])
@pytest.mark.parametrize(("steps", "options"), SOLVERS, ids=repr)
def test_a_law_of_ones_own_spends_w(own_law, which, steps, options):
    """In few steps as in many, in every solver, and follows its curve."""
    law = own_law.CONCRETE if which == "curve" else LinearSoftening(1e13, 3e6, 100.0)
    w = law.fracture_energy
    end = 2.0 * w / 3e6 if which == "kernels" else law.critical_opening
    opening, traction, energies = own_law.pull_apart(law, 1.1 * end, steps, **options)
    assert energies["dissipated_cohesion"] == pytest.approx(w, rel=1e-11)
    assert abs(energies["closure"]) < 1e-9 * w
    assert traction[opening > (1.0 + 1.2 / steps) * end] == pytest.approx(0.0, abs=1e-3)
    if steps == 200:
        exact = 3e6 * (1.0 - opening / end)
        if which == "curve":
            y = opening / end
            exact = 3e6 * ((1 + 27 * y**3) * np.exp(-6.93 * y) - 28 * y * np.exp(-6.93))
        on_curve = (opening > 0.15 * end) & (opening < end)
        assert np.abs(traction - exact)[on_curve].max() < 0.03 * 3e6  # of first order in the step


def test_a_curve_of_ones_own_in_a_static_run(own_law):
    law = own_law.CONCRETE
    opening, traction, energies = own_law.pull_apart(
        law, 1.1 * law.critical_opening, 40, theta=1.0, inertia=False
    )
    assert energies["dissipated_cohesion"] == pytest.approx(law.fracture_energy, rel=1e-9)
    y = np.minimum(opening / law.critical_opening, 1.0)
    exact = 3e6 * ((1 + 27 * y**3) * np.exp(-6.93 * y) - 28 * y * np.exp(-6.93))
    assert np.abs(traction - exact).max() < 1e-6 * 3e6  # on the curve at any step


@pytest.mark.parametrize("dim", [2, 3])
def test_a_law_of_ones_own_holds_a_mass_by_inertia(dim):
    """Torn by a mass in any direction, it takes w A from its kinetic energy."""
    from point_mass import PointMass

    velocity = np.array([3.0, 0.5, 0.2][:dim])
    mass = PointMass(LinearSoftening(100.0, 10.0, 1.0), 1.0, velocity)
    spent = sum(mass.step(0.02).cohesion for _ in range(25))
    assert spent == pytest.approx(1.0, rel=1e-12) and mass.damage == 0.0
    lost = 0.5 * (velocity @ velocity - mass.velocity.ravel() @ mass.velocity.ravel())
    assert lost == pytest.approx(1.0, rel=1e-10)


# -- commands


class Parsed(Exception):
    """A script has read its command line."""


def commands() -> list[str]:
    """What README and pages say to type after python3, from there to the end of code."""
    text = "\n".join(path.read_text() for path in [ROOT / "README.md", *PAGES])
    fenced = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
    blocks = fenced.findall(text)
    code = re.findall(r"`([^`\n]*python3 [^`\n]*)`", fenced.sub("", text))
    code += [line for block in blocks for line in block.splitlines() if "python3 " in line]
    found = [line.split("python3 ", 1)[1] for line in code]
    return sorted({line for line in found if re.match(r"(demos|benchmarks|docs)/\w+", line)})


def check_command(command: str, monkeypatch) -> None:
    """Run a script up to the point where it has read its command line."""
    script, *arguments = shlex.split(command)
    path = ROOT / script
    assert path.is_file(), command
    if "parse_args" not in path.read_text():
        assert not arguments, f"{script} takes no arguments: {command}"
        return
    own = argparse.ArgumentParser.parse_args

    def parse(self, args=None, namespace=None):
        own(self, args, namespace)
        raise Parsed

    with monkeypatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", parse)
        patch.setattr(sys, "argv", [script, *arguments])
        patch.syspath_prepend(str(path.parent))
        with pytest.raises(Parsed):
            runpy.run_path(str(path), run_name="__main__")


def test_commands_on_pages_can_be_typed(monkeypatch):
    found = commands()
    assert len(found) > 25
    for command in found:
        check_command(command, monkeypatch)


def test_commands_of_the_gallery_can_be_typed(gallery, monkeypatch):
    for figures in gallery.GALLERY:
        typed = figures.command(figures.folder).split("python3 ")[1]
        check_command(typed, monkeypatch)


def test_an_option_that_is_not_there_is_found(monkeypatch, capsys):
    with pytest.raises(SystemExit):
        check_command("demos/masonry_arch.py --no-such-option", monkeypatch)
    assert "--no-such-option" in capsys.readouterr().err


def test_files_named_on_pages_exist():
    for page in PAGES:
        for path in re.findall(r"(?:demos|benchmarks|tests)/[\w/]+\.py", page.read_text()):
            assert (ROOT / path).is_file(), f"{page.name}: {path}"
