# What all boards with an iCE40 have in common.
TOOLS := $(YOSYS) $(NEXTPNR_ICE40)
# Synapses and the buffer of events go to the large memories of one port (SPRAM), which are the largest of the device. Yosys puts
# an array there if its ram_style says so, and the attribute is set when memories are cells but not yet mapped.
ICE40 := synth_ice40 -dsp -spram -abc9 -device u -top top
SYNTHESIS := $(ICE40) -run begin:map_ram; setattr -set ram_style "huge" c:*synapses* c:*bitmap*; $(ICE40) -run map_ram:
PLACE = $(NEXTPNR_ICE40) $(PART) --pcf $(PINS) --asc $(BOARD)-$*.asc
BITSTREAM := $(BOARD).bin

$(BITSTREAM): $(FASTEST)
	$(ICEPACK) $(BOARD)-$$(cat $<).asc $@
