"""Records of one length and rate as one array in the band, and the network over them."""
