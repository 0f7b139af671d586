"""Plays pieces of the examples in a new order. This module is loaded by `motiongen list`: it imports nothing heavy."""

import motiongen as mg

SPEC = mg.GeneratorSpec(
    name="shuffle",
    description="Pieces of the examples in a new order, cut where poses are alike.",
    options="motiongen_shuffle.generator:ShuffleOptions",
    factory="motiongen_shuffle.generator:Shuffle",
)
