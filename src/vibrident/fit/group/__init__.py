"""Records of one length and rate as one array in the band of the motion, and their network there."""
