# iCEBreaker with an iCE40UP5K in a package of 48 pins.
DEVICE := ice40up5k
TOP := top_icebreaker.sv
PINS := icebreaker.pcf
TOOLS := $(YOSYS) $(NEXTPNR_ICE40)
# Synapses and the buffer of events go to the large memories of one port.
ICE40 := synth_ice40 -dsp -spram -abc9 -device u -top top
SYNTHESIS := $(ICE40) -run begin:map_ram; setattr -set ram_style "huge" c:*synapses* c:*bitmap*; $(ICE40) -run map_ram:
PLACE = $(NEXTPNR_ICE40) --up5k --package sg48 --freq 24 --pcf $(PINS) --asc $(BOARD)-$*.asc
BITSTREAM := $(BOARD).bin

$(BITSTREAM): $(BOARD)-1.json
	$(ICEPACK) $(BOARD)-1.asc $@
