"""What a result is used for: predict, correct, plan, compare, cross-validate."""
