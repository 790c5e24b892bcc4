"""Fine-tuning, and the data on which networks are trained and evaluated, for the verbs, the page and the evaluation.

The learning itself is in `ltvn_core.network`.
"""
