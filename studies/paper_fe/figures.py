"""Figures 9 to 14: the motions of the six parameter sets, beside what the paper says of them.

    python studies/paper_fe/figures.py                      # reduced fidelity, all geometries: the geometry's influence
    python studies/paper_fe/figures.py --fidelity full      # straight layer; arched where the motion settles soon
    python studies/paper_fe/figures.py --orbits             # and irregular motions by their exponent and 0-1 test

Records are kept in out/, and are taken from there; remove one to have it made anew.
"""

import argparse
import time
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure, SubFigure

from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.orbit_kind import OrbitKind
from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import OK, read, write
from calib.records.cycles import kind_of_motion
from calib.records.cycles.motion import NO_CONTACT
from calib.report.plots.style import MARK, MEASURED, SIMULATED, STYLE
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.delaminated_beam.options import Fidelity
from calib.study_file import load

HERE = Path(__file__).parent
PERIODS = 70  # of the paper's windows, 2.64 s
AXES = {False: (2.4, 0.75), True: (1.2, 0.20)}  # mm, m/s: of Figs. 9 to 11, and of 12 to 14
LARGE = 2.0  # times the layer's amplitude of Fig. 14 is a large one
YES, NO, OPEN = "yes", "no", "not told by the record"


@dataclass(frozen=True)
class Said:
    """What the paper says of a figure.

    Attributes
    ----------
    motion : in its words
    middle : whether the layer's middle is hit, None where the text does not say
    beside : whether there is contact beside the middle, likewise
    large : whether it says that the layer's amplitude is large
    start : of the window that it draws [s], None where the text has none
    """

    motion: str
    middle: bool | None = None
    beside: bool | None = None
    large: bool = False
    start: float | None = None


SAID = {
    9: Said("irregular", start=4.10),
    10: Said("bifurcated", start=10.00),
    11: Said("quasi-periodic", large=True, start=2.00),
    12: Said("period-1", middle=False, beside=True),
    13: Said("period-1", middle=True),
    14: Said("period-1", middle=True, start=25.0),
}
SETTLES = (12, 13, 14)  # alpha 500 1/s: the state returns within a few periods, long before the paper's window


@dataclass(frozen=True)
class Geometry:
    """One of the geometries that the text leaves open.

    Attributes
    ----------
    name, meaning : of files, for readers
    layer : "straight" or "arched"
    values : further than the sets'  [m]
    """

    name: str
    meaning: str
    layer: str = "straight"
    values: dict[str, float] = field(default_factory=dict)


GEOMETRIES = (
    Geometry("straight", "straight layer, a = 0.28 m (default)"),
    Geometry("straight_26", "straight layer, a = 0.26 m", values={"delamination": 0.52}),
    Geometry("straight_30", "straight layer, a = 0.30 m", values={"delamination": 0.60}),
    Geometry("arched", "arched layer, a = 0.28 m", "arched"),
    Geometry("arched_26", "arched layer, a = 0.26 m", "arched", {"delamination": 0.52}),
    Geometry("arched_30", "arched layer, a = 0.30 m", "arched", {"delamination": 0.60}),
    Geometry("arched_long", "arched layer, a = 0.28 m, beam 1.429 m", "arched", {"length": 1.429}),
)


def setting(
    number: int, geometry: Geometry = GEOMETRIES[0], fidelity: Fidelity = "reduced", **values: float
) -> Setting:
    """Model, excitation and values of a figure; `values` come before those of its study file."""
    held = load(HERE / f"fig{number:02d}.toml").setting({**geometry.values, **values})
    return Setting(Model(DelaminatedBeam(fidelity=fidelity, layer=geometry.layer)), held.excitation, held.values)


def motion(
    number: int, geometry: Geometry = GEOMETRIES[0], fidelity: Fidelity = "reduced", **values: float
) -> xr.Dataset:
    """Record of the paper's window; of a motion that settles, of two periods after it has."""
    held = setting(number, geometry, fidelity, **values)
    start = SAID[number].start
    if number in SETTLES or start is None:
        request = Request(periods=2, samples=800)
    else:
        request = Request(PERIODS, 400, settle=round(start * held.excitation.as_harmonic.frequency))
    return held.model.run(held.values, held.excitation, request)


def kept(number: int, geometry: Geometry, fidelity: Fidelity) -> xr.Dataset:
    """Return the same, from out/ where it is there."""
    path = HERE / "out" / f"fig{number:02d}_{geometry.name}_{fidelity}.nc"
    if not path.exists():
        began = time.process_time()
        record = motion(number, geometry, fidelity)
        path.parent.mkdir(exist_ok=True)
        write(record, path)
        print(f"{path.name}: {record.attrs['status']}, {time.process_time() - began:.0f} s of CPU", flush=True)
    return read(path)


@dataclass(frozen=True)
class Obtained:
    """What a record says of its motion.

    Attributes
    ----------
    kind : see `calib.records.cycles.kind_of_motion`, or `calib.dynamics.motion` where an orbit was asked for
    middle, beside : share of the time with contact in the middle, and of the place beside it that has most  [1]
    place : of the latter, 0 the middle and 1 the end of the delamination  [1]
    impacts : in the middle, closures a period that are 0.01 periods of no contact apart  [1]
    displacement, velocity : amplitudes of the layer  [m], [m/s]
    force : largest contact force  [N]
    """

    kind: str
    middle: float = float("nan")
    beside: float = float("nan")
    place: float = float("nan")
    impacts: float = float("nan")
    displacement: float = float("nan")
    velocity: float = float("nan")
    force: float = float("nan")


def obtained(record: xr.Dataset, orbit: OrbitKind | None = None) -> Obtained:
    """Read a record."""
    if record.attrs["status"] != OK:
        return Obtained(record.attrs["status"])
    share, place = record.contact_share.values, np.abs(record.contact_place.values)
    beside = int(np.argmax(np.where(place > 0.05, share, -1.0)))
    layer = record.sel(body="layer")
    return Obtained(
        kind=orbit.kind if orbit else kind_of_motion(record).kind,
        middle=float(share[np.argmin(place)]),
        beside=float(share[beside]),
        place=float(place[beside]),
        impacts=float(record.attrs["centre_impacts"]),
        displacement=0.5 * float(np.ptp(layer.displacement.values)),
        velocity=0.5 * float(np.ptp(layer.velocity.values)),
        force=float(record.attrs["contact_force_max"]),
    )


def verdicts(number: int, found: Obtained, calibrated: Obtained) -> dict[str, str]:
    """Say claim by claim whether what was found is what the paper says; `calibrated` is what Fig. 14 gives."""
    said, told = SAID[number], {}
    several = found.kind.startswith("period-") and found.kind != "period-1"
    if said.motion == "irregular":
        told["kind"] = YES if found.kind in ("irregular", "chaotic", "quasi-periodic") else NO
    elif said.motion == "bifurcated":
        told["kind"] = YES if several else NO
    elif said.motion == "quasi-periodic":
        told["kind"] = OPEN if found.kind == "irregular" else YES if found.kind == said.motion else NO
    else:
        told["kind"] = YES if found.kind == said.motion else NO
    if said.middle is not None:
        told["middle"] = YES if (found.middle > 0.0) == said.middle else NO
    if said.beside is not None:
        told["beside"] = YES if (found.beside > 0.0) == said.beside else NO
    if said.large:
        told["amplitude"] = YES if found.displacement > LARGE * calibrated.displacement else NO
    return told


def in_words(number: int) -> str:
    """What the paper says, in few words."""
    said = SAID[number]
    words = [said.motion]
    if said.middle is not None:
        words.append("contact in the middle" if said.middle else "none in the middle")
    if said.beside:
        words.append("contact beside it")
    if said.large:
        words.append("large layer amplitude")
    return ", ".join(words)


def table(found: dict[int, Obtained]) -> str:
    """Claims and what came out, a row a figure, as Markdown."""
    heads = ("Fig.", "the paper", "kind", "as said?", "middle closed", "beside it", "impacts there", "layer", "force")
    rows = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for number, one in found.items():
        told = ", ".join(f"{claim} {word}" for claim, word in verdicts(number, one, found[14]).items())
        rows.append(
            f"| {number} | {in_words(number)} | {one.kind} | {told} | {100 * one.middle:.2f} % "
            f"| {100 * one.beside:.1f} % at {one.place:.2f} | {one.impacts:.2f} "
            f"| {1e3 * one.displacement:.3f} mm, {one.velocity:.3f} m/s | {one.force:.3g} N |"
        )
    return "\n".join(rows)


def nearest(number: int, geometry: Geometry) -> float:
    """Smallest clearance [m] of beam and layer in the motion without contact that the reduced kernel settles to."""
    map = setting(number, geometry).map()
    return float(map.near_misses(map.orbit(map.initial, 20 if number in SETTLES else 300).states[-1]).min())


def influence(found: dict[str, dict[int, Obtained]]) -> str:
    """Kinds of motion over the geometries, as Markdown.

    In brackets the share of time for which the middle is closed, or of a motion without contact its smallest clearance.
    """
    rows = ["| geometry | " + " | ".join(f"Fig. {n}" for n in SAID) + " |", "|---" * (1 + len(SAID)) + "|"]
    for geometry in GEOMETRIES:
        if geometry.name in found:
            cells = [_cell(number, geometry, one) for number, one in found[geometry.name].items()]
            rows.append(f"| {geometry.meaning} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _cell(number: int, geometry: Geometry, one: Obtained) -> str:
    if one.kind == NO_CONTACT:
        return f"{one.kind} ({1e6 * nearest(number, geometry):.3g} um)"
    return f"{one.kind} ({100 * one.middle:.2f} %)"


def picture(records: dict[int, xr.Dataset], found: dict[int, Obtained], title: str) -> Figure:
    """Phase curves, section of the layer and contact along the delamination, a block a figure."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.5, 10.0), layout="constrained")
        figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize=10)
        blocks = figure.subfigures(2, 3, squeeze=False, hspace=0.04, wspace=0.03)
        for block, (number, record) in zip(blocks.flat, records.items(), strict=True):
            _block(block, number, record, found, AXES[number in SETTLES])
    return figure


def _block(
    block: SubFigure, number: int, record: xr.Dataset, found: dict[int, Obtained], scale: tuple[float, float]
) -> None:
    reach, fastest = scale
    one = found[number]
    told = verdicts(number, one, found[14])
    agrees = "; ".join(f"{claim}: {word}" for claim, word in told.items())
    values = load(HERE / f"fig{number:02d}.toml").setting().values
    block.suptitle(
        f"Fig. {number}: alpha {values.get('alpha', 500):g} 1/s, f {values['f']:g}, C {values['c_con']:g}, "
        f"g_max {1e3 * values['g_max']:g} mm, s {1e3 * values['s']:g} mm\npaper: {in_words(number)}\n"
        f"here: {one.kind}, middle closed {100 * one.middle:.2f} %, layer {1e3 * one.displacement:.2f} mm\n"
        f"as said? {agrees}",
        x=0.02, horizontalalignment="left", fontsize=8.5,
    )  # fmt: skip
    panels = block.subplot_mosaic([["curves", "curves"], ["section", "contact"]], height_ratios=(2.2, 1.0))
    curves, section, contact = (panels[name] for name in ("curves", "section", "contact"))
    width = 0.35 if record.sizes["time"] > 8000 else 1.2
    for body, colour in (("beam", MEASURED), ("layer", SIMULATED)):
        part = record.sel(body=body)
        curves.plot(1e3 * part.displacement, part.velocity, color=colour, linewidth=width, rasterized=True)
        curves.plot([], [], color=colour, label=body)
    layer = record.sel(body="layer")
    for axes in (curves, section):
        axes.plot(1e3 * layer.section_displacement, layer.section_velocity, ".", color=MARK, markersize=4.0, zorder=4)
        axes.set(xlabel="displacement [mm]", ylabel="velocity [m/s]")
    curves.set(xlim=(-reach, reach), ylim=(-fastest, fastest))
    curves.legend(loc="lower right", fontsize=7)
    section.set_title("section of the layer", fontsize=7.5)
    x, v = 1e3 * float(layer.section_displacement[-1]), float(layer.section_velocity[-1])
    section.set(xlim=(x - 0.15, x + 0.15), ylim=(v - 0.15, v + 0.15))
    contact.fill_between(np.abs(record.contact_place), 100.0 * record.contact_share, step="mid", color=SIMULATED)
    contact.set_title("closed [% of time]", fontsize=7.5)
    contact.set(xlabel="place (0 middle, 1 end)", xlim=(-0.03, 1.03))
    contact.set_ylim(0.0, max(5.0, 110.0 * float(record.contact_share.max())))


def main() -> None:
    """Make the records, print the tables, draw the pictures in out/."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fidelity", choices=("reduced", "full"), default="reduced")
    parser.add_argument("--orbits", action="store_true", help="kinds of irregular motions by exponent and 0-1 test")
    given = parser.parse_args()
    everything = {}
    for geometry in GEOMETRIES if given.fidelity == "reduced" else (GEOMETRIES[0], GEOMETRIES[3]):
        full_arched = given.fidelity == "full" and geometry.layer == "arched"
        records = {n: kept(n, geometry, given.fidelity) for n in (SETTLES if full_arched else SAID)}
        found = {n: obtained(record) for n, record in records.items()}
        everything[geometry.name] = found
        print(f"\n{geometry.meaning}, {given.fidelity} fidelity\n\n{table(found)}", flush=True)
        if len(records) == len(SAID):
            title = f"{geometry.meaning}, {given.fidelity} fidelity"
            path = HERE / "out" / f"figures_{geometry.name}_{given.fidelity}.png"
            picture(records, found, title).savefig(path, dpi=110)
    if given.fidelity == "reduced":
        print(f"\n{influence(everything)}")
    for number in (9, 10, 11) if given.orbits else ():
        orbit = kind_of_orbit(setting(number).map(), settle=300)
        print(f"\nFig. {number}: {orbit.kind}: {orbit.evidence}", flush=True)


if __name__ == "__main__":
    main()
