# ULX3S with an LFE5U-25F, speed grade 6.
DEVICE := ecp5-25f
PART := --25k
DEFINES := -DPLL_UP=24 -DPLL_DOWN=6
include ulx3s.mk
