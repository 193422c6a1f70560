// Takes apart one half of the words of a list whose targets are stored as steps (parameter STEP of the core), so that a synapse
// comes out as if its target were stored in full. Each half of a word has its own synapses, targets and exponents.
//
// A step is counted from the target of the synapse before it in the same half, and the first one from the head of the list. A
// step of 1 is the same target, of 2 the next target, and so on: a step s is s - 1 further on. A step of 0 marks a word
// without a synapse. Its mantissa field then holds a jump of -32 to 31 targets, and the exponent of the synapses that follow.
// So lists may have gaps of any size, any exponents, and targets in any order. hw_model/rtl/steps.py makes such lists.
module stepped #(
    parameter integer STEP = 3,         // bits of a step
    parameter integer TARGET_BITS = 7,  // bits of a target
    parameter integer SLOT_BITS = 1     // bits of a delay
) (
    input  logic                       clk,
    input  logic                       valid,   // `half` is of a word of a list
    input  logic                       first,   // this is the first word of the list
    input  logic [TARGET_BITS+2:0]     head,    // of the list: first exponent (3 bits), first target
    input  logic [STEP+SLOT_BITS+8:0]  half,    // mantissa (9 bits), delay, step
    // The synapse in full: mantissa, exponent, delay, target. Where there is none, mantissa and exponent are those of 0 * 2^7.
    output logic [TARGET_BITS+SLOT_BITS+11:0] synapse
);
    logic [TARGET_BITS+2:0] last;  // exponent and target of the word before
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
