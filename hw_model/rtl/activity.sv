// Counts what a recording makes the core do. The counters are answered together with the class of the recording; `clear`,
// between recordings, sets them to 0. An input counts in the cycle in which it is high.
module activity (
    input  logic        clk,
    input  logic        clear,
    input  logic [1:0]  add,            // a synapse is added, a bit per bank: 0, 1 or 2 in a cycle
    input  logic        update,         // a compartment was updated; the ports below say what happened to it
    input  logic        active,         // it had something to work on: a charge, state, bias or joined voltage
    input  logic        fired,          // it spiked; only together with `update`
    input  logic        charge_wrap,
    input  logic [1:0]  current_wraps,  // 0 to 2: of u, and of u plus bias
    input  logic        voltage_clip,
    output logic [31:0] synapses,
    output logic [31:0] updates,
    output logic [31:0] active_updates,
    output logic [31:0] spikes,
    output logic [31:0] charges_wrapped,
    output logic [31:0] currents_wrapped,
    output logic [31:0] voltages_clipped
);
    // To save energy on a chip, a counter is clocked only when it may change. On an FPGA, clock_gate passes every cycle, so the
    // conditions below repeat those of the gates.
    wire adding, updating;
    clock_gate adding_gate (.clk, .enable(clear || add != 0), .gated(adding));
    clock_gate updating_gate (.clk, .enable(clear || update), .gated(updating));
    always_ff @(posedge adding)
        if (clear || add != 0) synapses <= clear ? 0 : synapses + {30'b0, add[1] && add[0], add[1] != add[0]};
    always_ff @(posedge updating) begin
        if (clear || update) updates <= clear ? 0 : updates + 1;
        if (clear || (update && active)) active_updates <= clear ? 0 : active_updates + 1;
        if (clear || fired) spikes <= clear ? 0 : spikes + 1;
        if (clear || (update && charge_wrap)) charges_wrapped <= clear ? 0 : charges_wrapped + 1;
        if (clear || (update && current_wraps != 0))
            currents_wrapped <= clear ? 0 : currents_wrapped + {30'b0, current_wraps};
        if (clear || (update && voltage_clip)) voltages_clipped <= clear ? 0 : voltages_clipped + 1;
    end
endmodule
