"""The report that comes with every synthesis: how it compares with the examples, and how it was made."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from motiongen.contact import foot_joints
from motiongen.errors import MotionGenError
from motiongen.files import atomic_write
from motiongen.metrics import OneClipMetrics, one_clip_metrics
from motiongen.motion import Motion
from motiongen.quality import Quality, measure_quality

REPORTED_PACKAGES = ("motiongen", "torch", "numpy", "scipy")

# What the Markdown table shows of a clip's quality: heading, attribute, unit, decimals.
_COLUMNS = (
    ("foot skate", "foot_skate_cm_per_second", "cm/s", 2),
    ("foot skate", "foot_skate_heights_per_second", "heights/s", 4),
    ("jitter", "jitter_heights_per_second_cubed", "heights/s³", 1),
    ("largest turn", "largest_step_degrees", "°/frame", 1),
    ("largest step", "largest_step_heights", "heights/frame", 4),
    ("penetration", "penetration_heights", "heights", 4),
    ("contact", "contact_ratio", "share", 2),
)


@dataclass(frozen=True)
class Report:
    """A synthesis measured against its examples.

    Attributes:
        metrics: the one-clip metrics, or None with a reason in `remarks` where a clip is too short for them.
        examples: name -> quality of each example, at the frame rate of the syntheses.
        syntheses: name -> quality of each synthesis.
        run: how it was made: generator, options, seed, timing, versions, as plain data.
        remarks: what a reader should know, in words.
    """

    metrics: OneClipMetrics | None
    examples: Mapping[str, Quality]
    syntheses: Mapping[str, Quality]
    run: Mapping[str, Any]
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data."""
        return {
            "metrics": None if self.metrics is None else self.metrics.to_dict(),
            "examples": {name: quality.to_dict() for name, quality in self.examples.items()},
            "syntheses": {name: quality.to_dict() for name, quality in self.syntheses.items()},
            "run": dict(self.run),
            "remarks": list(self.remarks),
        }

    def to_markdown(self) -> str:
        """The report as a page of Markdown."""
        lines = ["# Synthesis report", ""]
        lines += [f"- {key.replace('_', ' ')}: {_text(value)}" for key, value in self.run.items()]
        lines += [f"- note: {remark}" for remark in self.remarks]
        if self.metrics is not None:
            lines += ["", "## Against the examples", "", *_metrics_table(self.metrics)]
        lines += ["", "## Quality, beside the examples' own", "", *self._quality_table()]
        return "\n".join(lines) + "\n"

    def save(self, folder: Path) -> tuple[Path, Path]:
        """Write `report.json` and its twin `report.md` into `folder`."""
        as_json, as_markdown = folder / "report.json", folder / "report.md"
        for path, text in (
            (as_json, json.dumps(self.to_dict(), indent=2) + "\n"),
            (as_markdown, self.to_markdown()),
        ):
            with atomic_write(path) as file:
                file.write(text.encode())
        return as_json, as_markdown

    def _quality_table(self) -> list[str]:
        known = (*self.examples.values(), *self.syntheses.values())
        columns = [c for c in _COLUMNS if any(getattr(q, c[1]) is not None for q in known)]
        if any(c[1] == "foot_skate_cm_per_second" for c in columns):  # heights serve only where centimetres cannot
            columns = [c for c in columns if c[1] != "foot_skate_heights_per_second"]
        rows = [["clip", *(f"{heading} ({unit})" for heading, _, unit, _ in columns)]]
        for kind, clips in (("example", self.examples), ("synthesis", self.syntheses)):
            for name, quality in clips.items():
                figures = [_figure(getattr(quality, attribute), decimals) for _, attribute, _, decimals in columns]
                rows.append([f"{kind} {name}", *figures])
        return markdown_table(rows)


def make_report(
    examples: Sequence[Motion],
    syntheses: Sequence[Motion],
    run: Mapping[str, Any],
    metrics_rate: float = 30.0,
    in_parts: bool = False,
) -> Report:
    """Measure syntheses against their examples.

    Args:
        examples: the clips given.
        syntheses: the clips made, at one frame rate.
        run: how they were made, as plain data; versions of the packages at work are added.
        metrics_rate: rate in Hz at which quality is measured; jitter and steps mean nothing across rates.
        in_parts: whether the examples know only a part of the character, so that there is nothing to compare poses to.
    """
    remarks = list(dict.fromkeys(f"{clip.name}: {note}" for clip in (*examples, *syntheses) for note in clip.notes))
    metrics = None
    try:
        if in_parts or not examples:
            raise MotionGenError("none of them knows the whole character" if in_parts else "there are none")
        metrics = one_clip_metrics(examples, syntheses)
    except MotionGenError as error:
        remarks.append(f"no metrics against the examples: {error}")
    rate = min(metrics_rate, *(clip.frame_rate for clip in (*examples, *syntheses)))

    feet = foot_joints(list(examples or syntheses))

    def measured(clips: Sequence[Motion]) -> dict[str, Quality]:
        return {name: measure_quality(clip.resample(rate), feet) for name, clip in zip(_unique_names(clips), clips)}

    run = {**run, "quality_measured_at_hz": rate, "versions": _versions()}
    return Report(metrics, measured(examples), measured(syntheses), run, tuple(remarks))


def markdown_table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table; the first row is the heading, the first column left-aligned, the others right."""
    rule = ["---", *("---:" for _ in rows[0][1:])]
    return ["| " + " | ".join(row) + " |" for row in (rows[0], rule, *rows[1:])]


def _metrics_table(metrics: OneClipMetrics) -> list[str]:
    figures = [
        ("coverage", "share of the examples' 30-frame windows that appear; 1 is all", metrics.coverage),
        ("global patch distance", "0 copies long runs of the examples", metrics.global_patch_distance),
        ("local patch distance", "0 has every half second from the examples", metrics.local_patch_distance),
        ("set diversity", "0 makes the same motion every time", metrics.set_diversity),
    ]
    return markdown_table(
        [("metric", "mean", "meaning"), *((name, _figure(value, 4), text) for name, text, value in figures)]
    )


def _unique_names(clips: Sequence[Motion]) -> list[str]:
    names = [clip.name for clip in clips]
    return names if len(set(names)) == len(names) else [f"{name} ({i})" for i, name in enumerate(names)]


def _figure(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_text(entry)}" for key, entry in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(entry) for entry in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _versions() -> dict[str, str]:
    """Versions of Python and of the packages that the result depends on."""
    found = {"python": platform.python_version()}
    for package in REPORTED_PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
