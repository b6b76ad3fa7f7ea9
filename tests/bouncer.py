"""A program of a stranger: an oscillator with a stop, in C, that reads a deck and writes a table."""

import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from programs import required

SOURCE = r"""
/* x'' + c x' + k x = A cos(2 pi f t + p) in small steps, with a stop at x = gap that gives back -e v */
#include <math.h>
#include <stdio.h>
int main(int count, char **words) {
  double k, c, gap, e, f, a, p, end;
  int samples, inner = 20;
  FILE *deck = count > 1 ? fopen(words[1], "r") : 0;
  if (!deck || fscanf(deck, "%lf %lf %lf %lf %lf %lf %lf %lf %d", &k, &c, &gap, &e, &f, &a, &p, &end, &samples) != 9) {
    fprintf(stderr, "ERROR: cannot read the deck\n");
    return 2;
  }
  FILE *out = fopen("motion.csv", "w");
  double x = 0.0, v = 0.0, h = 1.0 / (f * samples), dt = h / inner;
  long last = lround(end * f * samples);
  fprintf(out, "time,x,v\n");
  for (long i = 0; i <= last; i++) {
    fprintf(out, "%.12e,%.12e,%.12e\n", i * h, 1e3 * x, 1e3 * v);
    for (int s = 0; s < inner; s++) {
      v += dt * (a * cos(2.0 * M_PI * f * (i * h + s * dt) + p) - c * v - k * x);
      x += dt * v;
      if (x > gap && v > 0.0) { x = gap; v = -e * v; }
    }
  }
  printf("%ld rows\n", last + 1);
  return fclose(out);
}
"""
TEMPLATE = """\
{{ stiffness }} {{ damping }} {{ gap }} {{ restitution }}
{{ excitation.frequency }} {{ excitation.amplitude }} {{ excitation.phase }}
{{ request.end }} {{ request.samples }}
"""
OPTIONS = {
    "template": ["deck.in.j2"],
    "run": ["./bouncer deck.in"],
    "parameters": {"stiffness": "1e4 1/s^2", "damping": "20 1/s", "gap": "1 mm", "restitution": 0.6},
    "drives": {"force": "mass"},
    "read": {
        "reader": "delimited",
        "file": "motion.csv",
        "bodies": {
            "mass": {
                "displacement": {"column": "x", "unit": "mm"},
                "velocity": {"column": "v", "unit": "mm/s"},
            }
        },
    },
}


@cache
def program() -> Path:
    """Path of the compiled program; the test skips without a compiler."""
    folder = Path(mkdtemp(prefix="calib-test-bouncer-"))
    (folder / "bouncer.c").write_text(SOURCE)
    subprocess.run([required("cc"), "-O2", "-o", "bouncer", "bouncer.c", "-lm"], cwd=folder, check=True)
    return folder / "bouncer"


def lay_out(folder: Path) -> Path:
    """Put the program and its template into a folder, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bouncer").symlink_to(program())
    (folder / "deck.in.j2").write_text(TEMPLATE)
    return folder
