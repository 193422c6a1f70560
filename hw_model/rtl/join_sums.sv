// Joined compartments: adds up the voltages of siblings, which follow each other, and keeps the sum so far for their
// parent.
//
// A parent must come so much later than its last child that its read meets the written sum: JOIN_DISTANCE of
// hw_model/rtl/numbering.py sees to it.
module join_sums #(
    parameter integer WIDTH = 26,
    parameter integer COMPARTMENTS = 512
) (
    input  logic                            clk,
    input  logic                            child,
    input  logic                            first,
    input  logic                            last,  // or not: then the sum need not be written
    input  logic [$clog2(COMPARTMENTS)-1:0] parent,
    input  logic signed [23:0]              v,
    input  logic                            read,
    input  logic [$clog2(COMPARTMENTS)-1:0] read_address,
    output logic signed [WIDTH-1:0]         joined
);
    logic signed [WIDTH-1:0] so_far;
    wire signed [WIDTH-1:0] own = {{(WIDTH - 23) {v[23]}}, v[22:0]};
    wire signed [WIDTH-1:0] sum = first ? own : so_far + own;

    memory #(.WIDTH(WIDTH), .DEPTH(COMPARTMENTS)) sums (
        .clk,
        .write        (child && last),
        .write_address(parent),
        .write_data   (sum),
        .read,
        .read_address,
        .read_data    (joined)
    );

    always_ff @(posedge clk) if (child) so_far <= sum;
endmodule
