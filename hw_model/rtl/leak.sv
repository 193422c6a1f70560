// What a step leaves of a register: left = rz(x, d) = sign(x) * ((|x| * (4096 - d)) >> 12), truncated toward zero.
//
// `keep` is 4096 - d, from 0 to 4096: a decay d takes d / 4096 of x. The result comes two cycles after `x` and `keep`: first
// the products of the lower and the upper half of x, which fit the multipliers of an FPGA, then their sum.
//
// Cutting the low 12 bits off a two's complement number rounds it toward minus infinity, so the quotient of a negative product
// with a fraction is one too low: `up` adds 1 to it.
module leak (
    input  logic               clk,
    input  logic signed [23:0] x,
    input  logic [12:0]        keep,
    output logic signed [23:0] left
);
    logic [24:0]        low;   // of x[11:0]
    logic signed [24:0] high;  // of x[23:12], 4096 times as much
    logic               negative;
    wire                up = negative && low[11:0] != 0;
    // The lowest bit carries `up` into the sum.
    wire signed [25:0]  sum = {high, 1'b1} + {12'b0, low[24:12], up};

    always_ff @(posedge clk) begin
        low <= {13'b0, x[11:0]} * {12'b0, keep};
        high <= $signed({{13{x[23]}}, x[23:12]}) * $signed({12'b0, keep});
        negative <= x[23];
        left <= sum[24:1];
    end

    wire unused = &{1'b0, sum[25], sum[0]};
endmodule
