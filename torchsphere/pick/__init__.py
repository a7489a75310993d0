"""A page, served on this machine alone, on which a recording is prepared and measured: `torchsphere pick`."""
