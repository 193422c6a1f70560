# What all boards with an ECP5 have in common. Carry chains are mapped by carries.v, in between the steps of synth_ecp5.
TOOLS := $(YOSYS) $(NEXTPNR_ECP5)
SYNTHESIS := synth_ecp5 -top top -run begin:map_gates; techmap -map carries.v; opt -full; synth_ecp5 -top top -run map_gates:; script carries.ys
PLACE = $(NEXTPNR_ECP5) $(PART) --lpf $(PINS) --textcfg $(BOARD)-$*.config
BITSTREAM := $(BOARD).bit

$(BITSTREAM): $(FASTEST)
	$(ECPPACK) --compress $(BOARD)-$$(cat $<).config $@
