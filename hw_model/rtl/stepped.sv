// Half of the words of lists whose targets are told as steps from the synapse before them in the same half, and the first
// from the head of the list, which also gives the exponent. A step of 1 is the same target, one of 2 the next, and so on.
//
// A step of 0 is no synapse: it has a jump to what follows, forward or back, and another exponent. So lists may have gaps of
// any size, exponents of any kind, and targets in any order.
module stepped #(
    parameter integer STEP = 3,
    parameter integer TARGET_BITS = 7,
    parameter integer SLOT_BITS = 1
) (
    input  logic                       clk,
    input  logic                       valid,
    input  logic                       first,
    input  logic [TARGET_BITS+2:0]     head,    // exponent (3 bits), place
    input  logic [STEP+SLOT_BITS+8:0]  half,    // mantissa (9 bits), delay, step
    // As where targets are told in full: mantissa, exponent, delay, target. What is no synapse is 0 * 2^7.
    output logic [TARGET_BITS+SLOT_BITS+11:0] synapse
);
    logic [TARGET_BITS+2:0] last;
    wire  [TARGET_BITS+2:0] known = first ? head : last;
    wire  [TARGET_BITS-1:0] place = known[TARGET_BITS-1:0];
    wire  [8:0]             value;
    wire  [SLOT_BITS-1:0]   delay;
    wire  [STEP-1:0]        ahead;
    assign {value, delay, ahead} = half;
    wire                    none = ahead == 0;
    wire  [TARGET_BITS-1:0] jump = $signed(value[8:3]);
    wire  [TARGET_BITS-1:0] target = place + (none ? jump : TARGET_BITS'(ahead) - 1'b1);
    wire  [2:0]             exponent = none ? value[2:0] : known[TARGET_BITS+2:TARGET_BITS];
    assign synapse = none ? {9'd0, 3'd7, delay, target} : {value, exponent, delay, target};

    always_ff @(posedge clk) if (valid) last <= {exponent, target};
endmodule
