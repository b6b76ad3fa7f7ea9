"""A sample of the tests of compliant contact, with its kernel as plain Python: compiling takes longer than these."""

import os
import subprocess
import sys
from pathlib import Path

import calib

SAMPLE = """
from effects import test_conformance as effects
from simulators import test_compliant_contact as contact, test_contact_laws as laws

for law in contact.LAWS:
    contact.test_the_motion_agrees_with_dop853(law, 0)
    contact.test_a_graze_is_judged_by_its_depth_however_short_it_is(law, 1e-8)
    contact.test_energy_never_grows_without_excitation(law)
contact.test_the_motion_agrees_with_dop853("kelvin_voigt", 1)
contact.test_parted_bodies_meet_anew_before_they_have_separated(1.3)
contact.test_finer_numerics_give_the_same_motion("kelvin_voigt", 1.0)
contact.test_a_start_beyond_the_surface_is_pressed_or_parted_as_its_force_is()
contact.test_a_mass_that_has_bounced_out_rests_in_its_dent()
contact.test_force_laws_act_in_the_contact_as_out_of_it("kelvin_voigt", "interface")
laws.test_a_kelvin_voigt_contact_has_the_restitution_that_it_is_given(time=1e-2, e=0.5)
laws.test_the_restitution_of_a_hunt_crossley_contact_does_not_depend_on_its_exponent(exponent=1.5, loss=0.3)
laws.test_the_restitution_of_a_lankarani_nikravesh_contact_does_not_depend_on_the_speed(exponent=1.5, speed=0.05)
for case in effects.CASES:
    if case.effect.name in effects.YIELDING:
        effects.Tried().on(case).test_it_shows_where_it_is_present()
effects.test_the_stop_of_an_oscillator_yields_too()
"""


def test_the_kernel_as_plain_python_passes_a_sample():
    roots = [Path(__file__).parents[1], Path(calib.__file__).parents[1]]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(map(str, roots))}
    done = subprocess.run(
        [sys.executable, "-c", SAMPLE], env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
