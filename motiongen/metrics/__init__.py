"""Metrics: functions of motions, never of a generator."""

from motiongen.metrics.one_clip import (
    OneClipMetrics,
    coverage,
    global_patch_distance,
    local_patch_distance,
    one_clip_metrics,
    set_diversity,
)

__all__ = [
    "OneClipMetrics",
    "coverage",
    "global_patch_distance",
    "local_patch_distance",
    "one_clip_metrics",
    "set_diversity",
]
