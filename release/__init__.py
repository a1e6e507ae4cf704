"""The release: what is uploaded, and the check of it in fresh environments."""
