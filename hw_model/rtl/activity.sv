// What a recording made the core do: integers that are answered with its class.
module activity (
    input  logic        clk,
    input  logic        clear,
    input  logic [1:0]  add,
    input  logic        update,
    input  logic        active,
    input  logic        fired,
    input  logic        charge_wrap,
    input  logic [1:0]  current_wraps,
    input  logic        voltage_clip,
    output logic [31:0] synapses,
    output logic [31:0] updates,
    output logic [31:0] active_updates,
    output logic [31:0] spikes,
    output logic [31:0] charges_wrapped,
    output logic [31:0] currents_wrapped,
    output logic [31:0] voltages_clipped
);
    // A counter is clocked only where it changes.
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
