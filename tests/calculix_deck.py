"""A block of one element in CalculiX, pushed at one corner: printed results and nodal results of 7 increments."""

import subprocess

from programs import required

DECK = """*NODE, NSET=NALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., .1, 0.
4, 0., .1, 0.
5, 0., 0., .1
6, 1., 0., .1
17, 1., .1, .1
8, 0., .1, .1
*ELEMENT, TYPE=C3D8I, ELSET=EALL
1, 1, 2, 3, 4, 5, 6, 17, 8
*NSET, NSET=NFIX
1, 4, 5, 8
*NSET, NSET=NTIP
17
*NSET, NSET=NTWO
2, 17
*MATERIAL, NAME=STEEL
*ELASTIC
210000., .3
*DENSITY
7.8e-9
*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL
*BOUNDARY
NFIX, 1, 3
*STEP, INC=100, NLGEOM
*DYNAMIC, DIRECT
1e-5, 5e-5
*CLOAD
17, 3, 1.
{requests}
*END STEP
*STEP, INC=100, NLGEOM
*DYNAMIC, DIRECT
1e-5, 2e-5
{requests}
*END STEP
"""
PRINTED = """*NODE PRINT, NSET=NTIP
U, V
*NODE PRINT, NSET=NTWO
U
*NODE PRINT, NSET=NFIX, TOTALS=YES
RF
*NODE PRINT, NSET=NFIX, TOTALS=ONLY
RF
*EL PRINT, ELSET=EALL
S, ENER, ELSE, EVOL"""
FILED = """*NODE FILE, NSET=NTWO
U, V, RF
*EL FILE
S, E"""
BINARY = "*NODE OUTPUT, NSET=NTWO\nU, V, RF"
INCREMENTS = 7
TIME_STEP = 1e-5  # s


def solve(folder, *requests):
    """Run CalculiX in a folder; return the path of its results without their suffix."""
    program = required("ccx")
    (folder / "deck.inp").write_text(DECK.format(requests="\n".join(requests)))
    done = subprocess.run([program, "-i", "deck"], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    return folder / "deck"
