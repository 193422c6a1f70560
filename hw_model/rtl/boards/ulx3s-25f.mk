# ULX3S with an LFE5U-25F, speed grade 6.
DEVICE := ecp5-25f
PART := --25k
include ulx3s.mk
