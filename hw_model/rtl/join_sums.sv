// Joined compartments: a child adds its voltage to that of its parent in the same step. Children of one parent (siblings)
// leave the pipeline of update.sv one after the other; this module adds their voltages up and keeps the sum for the parent,
// which reads it when its own step begins. `joined` is the sum at `read_address`, in the cycle after `read`.
//
// The parent must be issued so much later than its last child that it reads the sum after it was written: JOIN_DISTANCE of
// hw_model/rtl/numbering.py sees to that.
module join_sums #(
    parameter integer WIDTH = 26,         // bits of a sum, sign included
    parameter integer COMPARTMENTS = 512  // words for sums
) (
    input  logic                            clk,
    input  logic                            child,   // a child comes out of the pipeline, with its voltage `v`
    input  logic                            first,   // it is the first of its siblings: the sum begins anew
    input  logic                            last,    // it may be the last; where it is not, the sum need not be written
    input  logic [$clog2(COMPARTMENTS)-1:0] parent,  // the word of its parent's sum
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
