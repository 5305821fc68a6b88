"""Which pixels are cloth, braid and tape: the coarse outline that the fine steps start from."""
