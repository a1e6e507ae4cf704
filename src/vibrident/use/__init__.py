"""Uses of a result: predict, correct, plan, compare, cross-validate."""
