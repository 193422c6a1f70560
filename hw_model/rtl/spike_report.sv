// Spikes for the host: each as the number of compartments that were updated before it in its recording.
//
// Updates follow a fixed order, so the number tells the step and the compartment. Spikes that find the queue full are
// counted, and the count is answered with the class.
module spike_report #(
    parameter integer DEPTH = 256  // a power of two
) (
    input  logic        clk,
    input  logic        reset,
    input  logic        wanted,
    input  logic        running,
    input  logic        update,
    input  logic        fired,
    output logic        head_valid,
    output logic [23:0] head,
    output logic        more,   // another one waits behind the head
    input  logic        pop,
    output logic [23:0] lost
);
    logic [23:0]          index;
    wire                  full;
    wire [$clog2(DEPTH):0] level;
    wire                  spike = wanted && running && update && fired;
    assign more = level > 1;

    held_queue #(.WIDTH(24), .DEPTH(DEPTH)) waiting (
        .clk, .clear(reset || !wanted), .push(spike && !full), .pushed(index), .commit(1'b1), .drop(1'b0), .full,
        .head_valid, .head, .pop, .level
    );

    always_ff @(posedge clk) begin
        if (update) index <= index + 1;
        if (spike && full) lost <= lost + 1;
        if (!running) {index, lost} <= 0;
    end
endmodule
