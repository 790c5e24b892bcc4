"""Joins training data, simulation and network: what networks are trained and judged on.

Here `sim`, `data` and `model` meet, for the verbs, the page and the evaluation. Learning itself is `ltvn_core.network`.
"""
