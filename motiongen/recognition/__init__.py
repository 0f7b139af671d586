"""Recognition of motions: what a motion is, and features to compare sets of motions by."""

from motiongen.recognition.recogniser import Card, Recogniser

__all__ = ["Card", "Recogniser"]
