"""One engine for every kind of data: is the model right, and if not, what is wrong.

It knows only :mod:`trunnion.diagnosis.model`; :mod:`trunnion.models` has the kinds of data.
"""
