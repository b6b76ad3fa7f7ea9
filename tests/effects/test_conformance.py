"""The effects that come with calib pass the suite that is given to others."""

import pytest

from calib.effects import channel_lag, gap_offset, quadratic_drag
from calib.plugins import names
from calib.testing import EffectSuite


class TestQuadraticDrag(EffectSuite):
    effect = quadratic_drag.EFFECT
    present = {"c2": 0.5}


class TestGapOffset(EffectSuite):
    effect = gap_offset.EFFECT
    present = {"dg": 1e-4}


class TestChannelLag(EffectSuite):
    effect = channel_lag.EFFECT
    present = {"lag": 1e-4}


def test_every_registered_effect_is_tried():
    tried = {s.effect.name for s in (TestQuadraticDrag, TestGapOffset, TestChannelLag)}
    assert tried == set(names("calib.effects"))


def test_drag_opposes_the_motion():
    law, p = quadratic_drag.EFFECT.law.function, quadratic_drag.EFFECT.bound({"c2": 2.0}).p
    assert law(0.0, 0.0, 0.5, p, p, p) == pytest.approx(-0.5)
    assert law(0.0, 0.0, -0.5, p, p, p) == pytest.approx(0.5)
