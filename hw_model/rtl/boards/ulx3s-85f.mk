# ULX3S with an LFE5U-85F, speed grade 6.
DEVICE := ecp5-85f
PART := --85k
DEFINES := -DPLL_UP=26 -DPLL_DOWN=8 -DMEMORY_BLOCK=16384
include ulx3s.mk
