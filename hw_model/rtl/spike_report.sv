// Spikes for the host: each as the number of compartments that were updated before it in its recording.
//
// Updates follow a fixed order, step by step and in each by compartment, so the number tells both. Steps wait while half of the queue is
// taken. Spikes of a step that still find it full are counted, and the count is answered with the class.
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
    output logic [23:0] lost,
    output logic        crowded  // half of the queue is taken: steps should wait
);
    localparam logic [$clog2(DEPTH):0] HALF = ($clog2(DEPTH) + 1)'(DEPTH / 2);
    logic [23:0]          index;
    wire                  full;
    wire [$clog2(DEPTH):0] level;
    wire                  spike = running && update && fired;
    assign more = level > 1;

    held_queue #(.WIDTH(24), .DEPTH(DEPTH)) waiting (
        .clk, .clear(reset || !wanted), .push(spike && !full), .pushed(index), .commit(1'b1), .drop(1'b0), .full,
        .head_valid, .head, .pop, .level
    );

    always_ff @(posedge clk) begin
        crowded <= level >= HALF;
        if (update) index <= index + 1;
        if (spike && full) lost <= lost + 1;
        if (!running) {index, lost} <= 0;
    end
endmodule
