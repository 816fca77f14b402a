"""The run-time check that tests put on every annotated function of the package."""

from beartype import BeartypeConf, beartype

# An int where a float is announced is what the typing rules (PEP 484) allow.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))
