"""Proof that every frame shows what it should, while capturing and over a recorded session.

Frames are judged in units: the frames of one family and pitch against each other, references
against those before. A unit is judged when its last frame is there, from a few thousand samples
of each frame; what is judged, and so what is taken again, depends on the session's lines alone,
whatever interrupted the capture.
"""

from acquire.proof.clocks import camera_clock_jumps
from acquire.proof.examination import Examination
from acquire.proof.portraits import keep_portraits
from acquire.proof.prover import Prover
from acquire.proof.recorded import Recorded
from acquire.proof.records import FrameProof, read_proofs
from acquire.proof.samples import FrameSamples, sample_frame
from acquire.proof.summary import proof_of, proven
from acquire.proof.units import Unit, units_of
from acquire.proof.verdict import verdict

__all__ = [
    "Examination",
    "FrameProof",
    "FrameSamples",
    "Prover",
    "Recorded",
    "Unit",
    "camera_clock_jumps",
    "keep_portraits",
    "proof_of",
    "proven",
    "read_proofs",
    "sample_frame",
    "units_of",
    "verdict",
]
