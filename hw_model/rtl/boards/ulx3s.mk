# What all ULX3S boards have in common.
TOP := top_ulx3s.sv
PINS := ulx3s.lpf
TOOLS := $(YOSYS) $(NEXTPNR_ECP5)
SYNTHESIS := synth_ecp5 -top top -run begin:map_gates; techmap -map carries.v; opt -full; synth_ecp5 -top top -run map_gates:; script carries.ys
PLACE = $(NEXTPNR_ECP5) $(PART) --package CABGA381 --speed 6 --lpf $(PINS) --textcfg $(BOARD)-$*.config
BITSTREAM := $(BOARD).bit

$(BITSTREAM): $(BOARD)-1.json
	$(ECPPACK) --compress $(BOARD)-1.config $@
