"""One creature out of parts of several characters: the union of their skeletons, and their clips written on it.

The data side of motion reassembly (GenMM, sections 3.4 and 5). Characters may differ in everything: joints and names,
bone lengths and unit, frame rate, which way they face, what the axes of their joints mean. What makes them comparable
is their stance (`motiongen.stance`): a part keeps the orientation that it has on average in its own character, relative
to that character's front and to up, and a joint that two characters share turns alike about its two mean poses.

    body = PartSource(walk)
    head = PartSource(elephant, joints="Bip01_Head", replaces="Head")
    creature = assemble([body, head])
    generator = mg.create("genmm").fit(creature.clips)  # the clips of both on creature.skeleton
    generator.sample(600, constraints=[creature.constraint])  # the head moves as the elephant's, the rest as the walk
"""

from motiongen.reassembly.assembly import Assembly, Link, Part
from motiongen.reassembly.build import assemble
from motiongen.reassembly.source import PartSource

__all__ = ["Assembly", "Link", "Part", "PartSource", "assemble"]
