"""Binary glTF 2.0: what game engines, web pages and Mixamo-like libraries exchange characters in.

`container` holds the file's two chunks and typed arrays in them, `reader` finds the animated skeleton, `writer` makes a
file of its own or puts a new animation into the one that a clip came from, `bones` draws a mesh for a bare skeleton.
"""

from motiongen.io.glb.reader import read_glb
from motiongen.io.glb.writer import write_glb

__all__ = ["read_glb", "write_glb"]
