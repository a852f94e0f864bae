# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every figure of the documentation, and the command that makes it.

    ./fenicsx python3 docs/gallery.py --list
    ./fenicsx python3 docs/gallery.py masonry_arch own_material
    ./fenicsx python3 docs/gallery.py --cost seconds minutes

The first prints the table, the others run commands again and put what they draw into `docs/` (or
`--into`). The same table makes the gallery's page and the figures on the pages of the demos.
"""

import argparse
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COSTS = ("seconds", "minutes", "long")


@dataclass(frozen=True)
class Figures:
    """What one command draws.

    Args:
        script: demo or benchmark, from the root of the repository.
        arguments: of its command line; "{out}" stands for the folder it writes into.
        drawn: file in that folder of each figure (.png) or film (.gif), by its name in `docs/`.
        captions: of each figure, in the same order.
        cost: one of COSTS, on one core: up to two minutes, up to ten, maybe more.
        variables: environment of the command.
    """

    script: str
    arguments: str
    drawn: dict[str, str]
    captions: tuple[str, ...]
    cost: str
    variables: str = ""

    def command(self, out: str) -> str:
        """The command as it is typed.

        Args:
            out: folder that it writes into.
        """
        arguments = self.arguments.format(out=out)
        return f"{self.variables} ./fenicsx python3 {self.script} {arguments}".strip()

    @property
    def files(self) -> dict[str, str]:
        """File that the command writes, by the file in `docs/` that it becomes."""
        return {f"{name}{Path(file).suffix}": file for name, file in self.drawn.items()}

    @property
    def demo(self) -> str | None:
        """Name of the demo, None for a benchmark."""
        path = Path(self.script)
        return path.stem if path.parent.name == "demos" else None

    @property
    def folder(self) -> str:
        """Where results go unless another folder is asked for."""
        return f"results/{Path(self.script).stem}"


GALLERY = (
    Figures(
        "demos/notched_plate.py",
        "--out {out}",
        {"notched_plate": "cracks.png", "stress_strain": "stress_strain.png"},
        (
            "A notched plate: cracks along weak interfaces, through strong ones",
            "Stress against strain of the two plates",
        ),
        "seconds",
    ),
    Figures(
        "demos/dynamic_branching.py",
        "--facet 5e-4 --out {out}",
        {"dynamic_branching": "branching.png"},
        ("A plate of glass: a crack that branches",),
        "seconds",
    ),
    Figures(
        "demos/fragmentation.py",
        "--cells 12 --out {out}",
        {"fragmentation": "pieces.png"},
        ("A ring that expands and flies to pieces",),
        "minutes",
    ),
    Figures(
        "demos/accuracy_cost.py",
        "--time cpu_seconds --out {out}",
        {"accuracy_cost": "first.png"},
        ("Error against processor time of a plate that breaks",),
        "long",
    ),
    Figures(
        "demos/periodic_ductile.py",
        "--out {out}",
        {"periodic_ductile": "cracks.png"},
        ("A periodic ductile composite: first cracks, and the fractured cell",),
        "long",
    ),
    Figures(
        "demos/intergranular.py",
        "--out {out}",
        {"intergranular": "cracks.png"},
        ("A polycrystal: first cracks around the hard grains, and the fractured cell",),
        "long",
    ),
    Figures(
        "demos/impact_fragmentation.py",
        "--out {out}",
        {"impact_fragmentation": "frames.png", "impact_energies": "energies.png"},
        ("A slab breaks under a ball, and its pieces pile up", "Its energies, and their closure"),
        "minutes",
    ),
    Figures(
        "demos/granular_packing.py",
        "--out {out}",
        {"granular_packing": "packing.png", "granular_pressure": "pressure.png"},
        ("Soft and rigid grains under a lid", "Pressure on the lid against packing fraction"),
        "minutes",
    ),
    Figures(
        "demos/masonry_arch.py",
        "--out {out}",
        {"masonry_arch": "masonry_arch.png"},
        ("Masonry arches just above and just below the thickness that stands",),
        "seconds",
    ),
    Figures(
        "demos/wrecking_ball.py",
        "--out {out}",
        {"wrecking_ball": "wrecking_ball.png"},
        ("A ball on a chain of hinged bars, a plain column and a post-tensioned one",),
        "seconds",
    ),
    Figures(
        "benchmarks/joints.py",
        "--figure {out}/joints.png",
        {"joints": "joints.png"},
        ("Energy and gap of a hinge over ten thousand steps of a pendulum",),
        "minutes",
    ),
    Figures(
        "demos/silo_discharge.py",
        "--film --out {out}",
        {
            "silo_discharge": "frames.png",
            "silo_rates": "rates.png",
            "silo_film": "silo.gif",
        },
        (
            "A silo that empties: layers of grains, and the forces between them",
            "What leaves the silo over time, and rates against the opening beside Beverloo's law",
            "The silo, filmed",
        ),
        "minutes",
    ),
    Figures(
        "demos/fracture_3d.py",
        "--out {out}",
        {"fracture_3d": "crack.png"},
        ("The crack of a bar with a tilted slit, each tetrahedron a body",),
        "seconds",
    ),
    Figures(
        "demos/subdomains.py",
        "--out {out}",
        {"subdomains": "iterations.png"},
        ("Iterations of perfect bonds against the number of subdomains",),
        "seconds",
    ),
    Figures(
        "demos/own_material.py",
        "--out {out}",
        {"own_material": "stress_strain.png"},
        ("A creeping metal with a void, and without, beside an integration apart",),
        "seconds",
    ),
    Figures(
        "demos/slow_fracture.py",
        "--out {out}",
        {"slow_fracture": "slow_fracture.png"},
        ("A panel of concrete, lifted slowly: load against the experiment, and the crack",),
        "seconds",
    ),
    Figures(
        "benchmarks/snap_back.py",
        "--figure {out}/snap_back.png",
        {"snap_back": "snap_back.png"},
        ("A notched bar that snaps back, beside an arc-length solution written apart",),
        "minutes",
    ),
    Figures(
        "benchmarks/million_points.py",
        "--results {out}/million_points.json --figure {out}/million_points.png",
        {"million_points": "million_points.png"},
        ("Time and memory from ten thousand to a million interaction points",),
        "minutes",
    ),
    Figures(
        "benchmarks/healing.py",
        "heap --figure {out}/healing.png",
        {"healing": "healing.png"},
        ("Overlaps of discs that fall into a box, with and without healing",),
        "seconds",
    ),
    Figures(
        "benchmarks/hertz.py",
        "--figure {out}/hertz.png",
        {"hertz": "hertz.png"},
        ("Cylinder and sphere on a plane: Hertz; Cattaneo and Mindlin",),
        "long",
        "OPENBLAS_NUM_THREADS=1",
    ),
    Figures(
        "benchmarks/beam_delamination.py",
        "--quick --figure {out}/beam_delamination.png",
        {"beam_delamination": "beam_delamination.png"},
        ("Load against displacement of three delaminated beams, and beam theory",),
        "seconds",
    ),
    Figures(
        "benchmarks/mixed_mode_bending.py",
        "--out {out}",
        {"mixed_mode_bending": "mixed_mode_bending.png"},
        ("A laminate bent in mixed mode, from opening to shear: load, and beam theory",),
        "seconds",
    ),
    Figures(
        "benchmarks/elastica_peel.py",
        "--quick --figure {out}/elastica_peel.png",
        {"elastica_peel": "elastica_peel.png"},
        ("A strip peeled at three angles: load, and energy release rate of the elastica",),
        "minutes",
    ),
    Figures(
        "benchmarks/fault_rupture.py",
        "--facets 8 --figure {out}/fault_rupture.png",
        {"fault_rupture": "fault_rupture.png"},
        ("Ruptures on a fault, below the Rayleigh speed and above that of S waves",),
        "minutes",
    ),
    Figures(
        "benchmarks/masonry_panel.py",
        "--cells 1 --figure {out}/masonry_panel.png",
        {"masonry_panel": "masonry_panel.png"},
        ("Panels of bricks and mortar that rock, slide and break in steps",),
        "seconds",
    ),
    Figures(
        "benchmarks/deflection_or_penetration.py",
        "--figure {out}/deflection_or_penetration.png",
        {"deflection_or_penetration": "deflection_or_penetration.png"},
        ("A crack at an interface: ratio of energies, and where cracks with bonds turn",),
        "long",
    ),
    Figures(
        "benchmarks/crack_speed.py",
        "--figure {out}/crack_speed.png",
        {"crack_speed": "crack_speed.png"},
        ("Speed of a crack on a weak plane, Freund's equation of motion, Rayleigh's speed",),
        "long",
    ),
    Figures(
        "benchmarks/bar_fragmentation.py",
        "--figure {out}/bar_fragmentation.png",
        {"bar_fragmentation": "bar_fragmentation.png"},
        ("Pieces of a stretching bar: mean size against rate, and the distribution of sizes",),
        "minutes",
    ),
    Figures(
        "benchmarks/rattling_plate.py",
        "--figure {out}/rattling_plate.png",
        {"rattling_plate": "rattling_plate.png"},
        ("Energies of a broken plate whose pieces strike each other on and on",),
        "minutes",
    ),
    Figures(
        "benchmarks/kalthoff.py",
        "--facet 1e-3 --out {out}",
        {"kalthoff": "kalthoff.png"},
        ("Kalthoff and Winkler's plate, facets of 1 mm",),
        "minutes",
    ),
    Figures(
        "benchmarks/shear_cell.py",
        "--figure {out}/shear_cell.png",
        {"shear_cell": "shear_cell.png"},
        ("Plane shear of discs: friction and solid fraction against the inertial number",),
        "long",
    ),
    Figures(
        "benchmarks/stall_study.py",
        "--patience 100 --results {out}/stall_study.json --figure {out}/stall_study.png",
        {"stall_study": "stall_study.png"},
        ("Time to a residual of 1e-6 against the number of points, by solver",),
        "long",
    ),
)


def write_gallery(docs: Path) -> None:
    """Write the gallery's page.

    Args:
        docs: folder of the documentation.
    """
    text = (
        "# Gallery\n\nEach figure, the demo or benchmark that draws it, and the command. "
        "`./fenicsx python3 docs/gallery.py NAME` runs it again and replaces the figure;\n"
        "`--cost seconds minutes` runs all that take no longer. On one core, `seconds` is up to "
        "two minutes, `minutes` up to ten, `long` may be more.\n\n:::::{container} gallery\n"
    )
    for figures in GALLERY:
        page = f"demos/{figures.demo}.md" if figures.demo else None
        for file, caption in zip(figures.files, figures.captions, strict=True):
            source = f"[`{figures.script}`]({page})" if page else f"`{figures.script}`"
            text += (
                f"::::{{figure}} {file}\n:alt: {caption}\n:target: _images/{file}\n\n"
                f"{caption}. {source}\n::::\n"
            )
    text += ":::::\n\n## Commands\n\n| figure | command | cost |\n|---|---|---|\n"
    for figures in GALLERY:
        names = ", ".join(f"`{name}`" for name in figures.drawn)
        text += f"| {names} | `{figures.command(figures.folder)}` | {figures.cost} |\n"
    page = docs / "gallery.md"
    if not page.exists() or page.read_text() != text:
        page.write_text(text)


def draw(figures: Figures, out: Path, into: Path) -> None:
    """Run a command and take over what it has drawn.

    Args:
        figures: what to draw.
        out: folder for all that the command writes.
        into: folder for the figures, by their names in the documentation.

    Raises:
        subprocess.CalledProcessError: the command failed.
    """
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, figures.script, *shlex.split(figures.arguments.format(out=out))]
    subprocess.run(command, cwd=ROOT, check=True)
    for name, file in figures.files.items():
        shutil.copyfile(out / file, into / name)


def main(arguments: list[str] | None = None) -> None:
    """Draw the figures asked for again, or list all."""
    parser = argparse.ArgumentParser(description="Draw the figures of the documentation.")
    add = parser.add_argument
    known = [name for figures in GALLERY for name in figures.drawn]
    add("names", nargs="*", metavar="NAME", help=f"figures: {', '.join(known)}")
    add("--cost", nargs="+", choices=COSTS, help="all figures of these costs")
    add("--list", action="store_true", help="print figures, commands and costs, and stop")
    add("--out", type=Path, default=ROOT / "results" / "gallery", help="where runs write")
    add("--into", type=Path, default=ROOT / "docs", help="where figures go (default: docs)")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.names) - set(known))
    if unknown:
        parser.error(f"no figure is called {', '.join(unknown)}; these are: {', '.join(known)}")
    if options.list:
        for figures in GALLERY:
            print(f"{', '.join(figures.drawn)} ({figures.cost})")
            print(f"    {figures.command(figures.folder)}")
        return
    if not (options.names or options.cost):
        parser.error("name figures, or a cost")
    for figures in GALLERY:
        if set(options.names) & set(figures.drawn) or figures.cost in (options.cost or ()):
            draw(figures, (options.out / Path(figures.script).stem).resolve(), options.into)


if __name__ == "__main__":
    main()
