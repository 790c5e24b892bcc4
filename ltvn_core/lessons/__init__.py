"""What networks are taught and judged on: simulated scenes and a robot's own drive, put together for `ltvn_core.model`.

Here `sim`, `data` and `model` meet, for the verbs, the page and the evaluation. Learning itself is `ltvn_core.model`.
"""
