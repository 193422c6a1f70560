// The charges under way: a memory with one sum for every slot (a step to come) and compartment of a bank. An operation
// either adds `addend` to the sum at `address`, or takes the sum (`take`): `taken` shows it, and 0 is left in its place.
// An operation may start in every cycle.
//
//     cycle 0   the operation arrives, its address goes to the memory
//     cycle 1   the memory answers, late in the cycle, so its word goes straight into a register (`kept2`)
//     cycle 2   `taken` is the sum: the newest result for its address that is still in the pipeline, else the memory's word
//     cycle 3   the new sum, or 0 after a take, is written back
//
// A digit at the end of a name is the cycle in which the signal belongs to its operation. A charge is in units of 64 of
// a current's lowest bit.
//
// A word that is written in cycle 3 can be read from the next cycle on. So an operation that follows another one of the same
// address by one, two or three cycles read an old word, and takes the result from `written3`, `written4` or `written5`.
module accumulator #(
    parameter integer WIDTH = 18,   // bits of a charge, sign included: enough for the largest sum (images.py)
    parameter integer DEPTH = 1024  // charges
) (
    input  logic                     clk,
    input  logic                     valid,
    input  logic                     take,
    input  logic [$clog2(DEPTH)-1:0] address,
    input  logic [WIDTH-1:0]         addend,
    output logic [WIDTH-1:0]         taken,
    // Between recordings every word is set to 0. A sweep is a take of `sweep_address`, and never comes together with `valid`.
    input  logic                     sweep,
    input  logic [$clog2(DEPTH)-1:0] sweep_address
);
    logic                     valid1, valid2, valid3, valid4;
    logic                     take1, take2, sweep1, sweep2, write3;
    logic [$clog2(DEPTH)-1:0] address1, address2, address3, address4;
    logic [WIDTH-1:0]         addend1, addend2;
    logic [WIDTH-1:0]         stored, kept2, written3, written4, written5;
    // Whether the operation of cycle 2 has the address of the one in cycle 3, 4 or 5, whose result it takes. The addresses
    // are compared a cycle earlier, so that the choice of `taken` starts from registers.
    logic                     as3, as4, as5;

    assign taken = as3 ? written3 : as4 ? written4 : as5 ? written5 : kept2;

    // `valid4` needs no clock of its own: the first cycle of the next operation clears it, before that operation compares addresses.
    wire ticking;
    clock_gate gate (.clk, .enable(valid || valid1 || valid2 || valid3 || sweep), .gated(ticking));

    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH)) charges (
        .clk(ticking),
        .write        (write3),
        .write_address(address3),
        .write_data   (written3),
        .read         (valid),
        .read_address (address),
        .read_data    (stored)
    );

    always_ff @(posedge ticking) begin
        {valid1, take1, sweep1, addend1} <= {valid || sweep, take || sweep, sweep, addend};
        {valid2, take2, sweep2, addend2} <= {valid1, take1, sweep1, addend1};
        {valid3, valid4} <= {valid2, valid3};
        address1 <= sweep ? sweep_address : address;
        {address2, address3, address4} <= {address1, address2, address3};
        kept2 <= stored;
        {as3, as4, as5} <= {valid2 && address2 == address1, valid3 && address3 == address1, valid4 && address4 == address1};
        written3 <= take2 ? {WIDTH{1'b0}} : taken + addend2;
        write3 <= valid2 && (!take2 || taken != 0 || sweep2);  // a 0 that is taken is 0 already; a sweep writes even so, as a word may be unknown
        {written4, written5} <= {written3, written4};
    end
endmodule
