"""The one place that knows concrete devices: turns ``--bench`` into a projector and a camera.

A bench's module is imported when the bench is named: a real one needs no simulated scenes.
"""

from __future__ import annotations

from pathlib import Path

from acquire.bench_file import LabBench, ProjectorSection, SimBench, read_bench
from acquire.rig.bench import Bench, Resumption

__all__ = ["Bench", "Resumption", "find_bench"]


def find_bench(text: str, monitor: str | None = None) -> Bench:
    """The bench that ``--bench`` names: sim, lab, replay:SESSION or a TOML file.

    With `monitor` a real bench projects there, whatever its file says.
    """
    kind, _, rest = text.partition(":")
    if kind == "replay" and rest:
        from acquire.rig.replayed import replay_bench

        return replay_bench(Path(rest))
    named: dict[str, SimBench | LabBench] = {"sim": SimBench(), "lab": LabBench()}
    bench = named[text] if text in named else read_bench(Path(text))
    if isinstance(bench, SimBench):
        from acquire.rig.simulated import simulated_bench

        return simulated_bench(bench.sim)
    from acquire.rig.lab import lab_bench

    if monitor is not None:
        bench = bench.model_copy(update={"projector": ProjectorSection(monitor=monitor)})
    return lab_bench(bench)
