"""The two edges of the muscle to a fraction of a pixel, by a model of the lit limb under blur."""
