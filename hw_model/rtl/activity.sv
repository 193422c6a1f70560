// What a recording made the core do: integers that are answered with its class.
module activity (
    input  logic        clk,
    input  logic        clear,
    input  logic        add,
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
    always_ff @(posedge clk) begin
        synapses <= synapses + {31'b0, add};
        updates <= updates + {31'b0, update};
        active_updates <= active_updates + {31'b0, update && active};
        spikes <= spikes + {31'b0, fired};
        charges_wrapped <= charges_wrapped + {31'b0, update && charge_wrap};
        currents_wrapped <= currents_wrapped + (update ? {30'b0, current_wraps} : 32'd0);
        voltages_clipped <= voltages_clipped + {31'b0, update && voltage_clip};
        if (clear) begin
            {synapses, updates, active_updates, spikes} <= 0;
            {charges_wrapped, currents_wrapped, voltages_clipped} <= 0;
        end
    end
endmodule
