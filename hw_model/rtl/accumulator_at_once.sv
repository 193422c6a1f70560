// The charges under way, as in accumulator.sv and with its ports and timing, on a memory of latches that answers in the cycle
// in which it is asked and shows a written word in the next. An operation reads, adds and writes within one cycle, so nothing
// has to be forwarded. locsnn_core.sv uses it where its parameter AT_ONCE is 1, on a chip.
module accumulator_at_once #(
    parameter integer WIDTH = 18,   // bits of a charge
    parameter integer DEPTH = 1024  // charges
) (
    input  logic                     clk,
    input  logic                     valid,
    input  logic                     take,
    input  logic [$clog2(DEPTH)-1:0] address,
    input  logic [WIDTH-1:0]         addend,
    output logic [WIDTH-1:0]         taken,  // the sum of a take, two cycles after it, as in accumulator.sv
    input  logic                     sweep,  // clears sweep_address; never together with valid
    input  logic [$clog2(DEPTH)-1:0] sweep_address
);
    wire [$clog2(DEPTH)-1:0] at_address = sweep ? sweep_address : address;
    wire [WIDTH-1:0]         stored;
    logic [WIDTH-1:0]        taken1;
    logic                    take1;
    wire                     takes = valid && take;

    memory_at_once #(.WIDTH(WIDTH), .DEPTH(DEPTH)) charges (
        .clk,
        .write        (sweep || (valid && (!take || stored != 0))),  // a 0 that is taken is 0 already
        .write_address(at_address),
        .write_data   (sweep || take ? {WIDTH{1'b0}} : stored + addend),
        .read         (valid),
        .read_address (at_address),
        .read_data    (stored)
    );

    // The sum waits in `taken1`, so that it comes as late as from accumulator.sv. Both registers change with takes only.
    always_ff @(posedge clk) begin
        take1 <= takes;
        if (takes) taken1 <= stored;
        if (take1) taken <= taken1;
    end
endmodule
