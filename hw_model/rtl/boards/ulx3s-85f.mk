# ULX3S with an LFE5U-85F, speed grade 6.
DEVICE := ecp5-85f
PART := --85k
include ulx3s.mk
