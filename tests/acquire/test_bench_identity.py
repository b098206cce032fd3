"""Which descriptions mean the same bench: what may change between two nights, and what may not."""

import pytest
from pydantic import JsonValue

from acquire.bench_identity import are_same_devices, is_same_bench

Bench = dict[str, JsonValue]


def lab(
    monitor: str = "HDMI-1", camera: str = "3012345", body: str | None = None, **where: JsonValue
) -> Bench:
    bench: Bench = {
        "kind": "lab",
        "lab": {"projector": {"monitor": None}, "camera": {"address": None, **where}, "lamp": None},
        "monitor": monitor,
        "camera": camera,
        "projector_px": [768, 1024],
    }
    if body is not None:
        bench["camera_body"] = body
    return bench


@pytest.mark.parametrize(
    ("other", "same"),
    [
        pytest.param(lab(), True, id="nothing changed"),
        pytest.param(lab(transfer_s=2.0, frame_mb=30.0), True, id="other estimates"),
        pytest.param(lab(camera="0003012345"), True, id="its number in full"),
        pytest.param(
            lab(camera="usb:1,7", address="usb:1,7"), True, id="another port, number not known"
        ),
        pytest.param(lab(camera="3099999"), False, id="another camera"),
        pytest.param(lab(body="Maker One 7"), True, id="body known to one only"),
        pytest.param(lab(monitor="DP-2"), False, id="another projector"),
        pytest.param(lab() | {"projector_px": [600, 800]}, False, id="another resolution"),
        pytest.param({"kind": "sim", "sim": {"scene": "corner"}}, False, id="a simulated one"),
    ],
)
def test_a_lab_is_known_by_its_devices(other: Bench, same: bool) -> None:
    for one, two in ((lab(), other), (other, lab())):
        assert is_same_bench(one, two) is same
        assert are_same_devices(one, two) is same


def test_a_network_address_says_nothing_and_the_body_all() -> None:
    before = lab(camera="ptpip:10.0.0.5", address="ptpip:10.0.0.5", body="Maker One 7")
    moved = lab(camera="ptpip:10.0.0.9", address="ptpip:10.0.0.9", body="Maker One 7")
    lent = lab(camera="ptpip:10.0.0.5", address="ptpip:10.0.0.5", body="Maker One 8")
    assert is_same_bench(before, moved)
    assert not is_same_bench(before, lent)
    assert not are_same_devices(before, lent)
