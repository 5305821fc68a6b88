"""The tapes at the ends: where their inner edges lie, what covers them, how wide they are."""
