"""GenMM, generative motion matching (Li et al. 2023): one module per step of the paper.

`pyramid` (3.2) -> `matching` (3.3, Eq. 1 and 2) -> `blending` (3.3), repeated by `synthesis`; `generator` turns motions
into features and back. Tensors are (B, F, D): B syntheses of F frames with D features; examples are (T, D).
"""
