"""MoDi, unconditional motion synthesis (Raab et al. 2023): the networks, for any skeleton.

`hierarchy` makes coarser and coarser skeletons from the tree alone; `layers` are the skeletal convolution and the
convolutional scaler on them (section 3.2, appendix B.2), with modulation (appendix B.3); `networks` puts them together
(section 3.3, tables 3 and 4), as `options` says.

Motions are (B, T, E, K) outside: T frames of E entities with K features. Entities are the joints in the skeleton's
order, the root's motion, and one contact label for each foot joint. Inside, layers hold (E, B, T, K).
"""
