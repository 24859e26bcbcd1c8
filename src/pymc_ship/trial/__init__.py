"""The record of a trial: read, checked for form, written and polluted."""
