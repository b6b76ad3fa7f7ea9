"""How the stages of a diagnosis are said."""

from contextlib import nullcontext
from types import SimpleNamespace

from calib.diagnosis.discovery import discover as module
from calib.diagnosis.stages import Stages


def test_compiling_stands_behind_the_stage_that_it_holds_up():
    said = []
    stages = Stages(said.append)
    stages("suspects 1")
    stages.compiling(True)
    stages("suspects 2")
    stages.compiling(False)
    assert said == ["suspects 1", "suspects 1 (compiling)", "suspects 2 (compiling)", "suspects 2"]


def test_the_search_for_a_force_names_its_first_stage_before_it_simulates(monkeypatch):
    said = []
    monkeypatch.setattr(module, "bench_of", lambda study, others: bench)
    monkeypatch.setattr(module, "force_places", lambda simulator: ())
    monkeypatch.setattr(module, "visited_regions", lambda *arguments: said.append("simulated") or {})
    simulator = SimpleNamespace(name="still", sites=("force",))
    bench = SimpleNamespace(model=SimpleNamespace(simulator=simulator), objective=SimpleNamespace(references={}))
    study = SimpleNamespace(model=bench.model)
    found = module.discover(study, {}, {}, (), pool=lambda bench: nullcontext(SimpleNamespace()), on_stage=said.append)
    assert said == ["visited states", "simulated"]
    assert found.verdict == module.NOT_DIAGNOSABLE
