"""Questions that the records of the KVLCC2 answer, which an identification does not ask.

- `captive`: the parts fitted to captive tests alone, compared with the ship that was identified from zigzags.
- `nuts`: the No-U-Turn sampler, the normal approximation and the draws of an identification on the same windows.
"""
