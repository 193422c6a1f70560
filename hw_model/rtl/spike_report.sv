// Queues the spikes of a recording for the host. A spike is reported as the number of compartments that were updated before it in
// its recording. Updates follow a fixed order, step by step and by compartment within a step, so the host can tell both from it.
//
// `crowded` makes the steps of the core wait while half of the queue is taken. A step that has begun goes on, so its spikes may
// still find the queue full; these are counted as `lost`, and the count is answered with the class.
module spike_report #(
    parameter integer DEPTH = 256  // spikes that wait for the host; a power of two
) (
    input  logic        clk,
    input  logic        reset,
    input  logic        wanted,   // the host has asked for spikes
    input  logic        running,  // a recording is under way; the counts start with it
    input  logic        update,   // a compartment was updated
    input  logic        fired,    // that compartment fired
    output logic        head_valid,
    output logic [23:0] head,
    output logic        more,     // another spike waits behind the head
    input  logic        pop,
    output logic [23:0] lost,
    output logic        crowded  // half of the queue is taken: steps should wait
);
    localparam logic [$clog2(DEPTH):0] HALF = ($clog2(DEPTH) + 1)'(DEPTH / 2);
    logic [23:0]          index;  // compartments that were updated so far in the recording
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
