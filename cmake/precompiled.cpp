// Has nothing of its own: it carries the precompiled header that the rooms share.
