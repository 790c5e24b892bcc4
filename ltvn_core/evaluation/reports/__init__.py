"""Reports: figures, tables and pages about evaluations.

The only package that imports matplotlib and jinja2, which come with the extra `docs`. It computes no metrics; these
come from `ltvn_core.network` and `ltvn_core.evaluation`.
"""
