"""Forms of the page, made from the keys of the files that they fill in."""
