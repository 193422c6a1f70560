// Saves reads and writes of the memory of states. A compartment's state is its current u, its voltage v and the steps for which
// it is still blocked. Where the next step does not depend on the state, update.sv does not write it, and need not read it.
// This module remembers two bits of every compartment, from its last step, which say so before the state is read:
//
//     needed    nonzero
//       0          0      at rest: u and v are 0
//       0          1      u or v is not 0, but both decay to 0 within a step; the next step only counts as active
//       1          1      u or v is not 0, and a part of it is left in the next step: the state was written
//       1          0      blocked after a spike: v is 0, u may be anything; the state was written
//
// A step sweeps the compartments of a phase in order, a number per cycle. A word of the memory here holds the bits of a group
// of eight compartments, the first in the lowest bits. The word of the next group is read with the last compartment of a
// group, so it is there in time. The word of the first compartment of a sweep arrives a cycle too late, so its state is read
// in any case. Where the first compartment is the last of its group, the same is true of the second.
module at_rest #(
    parameter integer COMPARTMENTS = 512  // a power of two, at least 16
) (
    input  logic                            clk,
    // The compartment whose step begins in this cycle.
    input  logic                            issue,
    input  logic [$clog2(COMPARTMENTS)-1:0] number,
    output logic                            read,          // its state must be read: it is needed, or that is not known yet
    // The same compartment, a cycle later.
    output logic                            needed,
    output logic                            nonzero,
    // The compartment whose step ends in this cycle, and its bits for the next step.
    input  logic                            done,
    input  logic                            last,          // of its sweep: its group is written although it is not full
    input  logic [$clog2(COMPARTMENTS)-1:0] done_number,
    input  logic                            done_needed,
    input  logic                            done_nonzero
);
    localparam integer NUMBER = $clog2(COMPARTMENTS);
    localparam integer IN_GROUP = 3;  // bits of a place in a group of eight
    localparam integer GROUP = NUMBER - IN_GROUP;
    localparam logic [IN_GROUP-1:0] LAST_IN_GROUP = 7;

    wire [GROUP-1:0]    group = number[NUMBER-1:IN_GROUP], done_group = done_number[NUMBER-1:IN_GROUP];
    wire [IN_GROUP-1:0] place = number[IN_GROUP-1:0], done_place = done_number[IN_GROUP-1:0];

    // Reading. A 1 at the end of a name means a cycle later. `unknown`: the bits of `number` are not in `group_bits` yet.
    logic [15:0]         group_bits;  // of the group of `number`, unless `unknown`
    logic                issued1, unknown1;
    logic [IN_GROUP-1:0] place1;
    logic [1:0]          bits1;
    wire  [1:0]          bits = group_bits[2*place+:2];
    wire                 first_of_sweep = issue && !issued1;
    wire                 second_in_next_group = issue && unknown1 && place == 0;
    wire                 unknown = first_of_sweep || second_in_next_group;
    assign read = issue && (unknown || bits[0]);
    // Bits that were unknown are there a cycle later, when the memory has answered.
    assign {nonzero, needed} = unknown1 ? group_bits[2*place1+:2] : bits1;

    // Writing: the bits of a group are collected, and written together with the last compartment of the group or the sweep.
    logic [15:0] collected, with_done;
    always_comb begin
        with_done = collected;
        with_done[2*done_place+:2] = {done_nonzero, done_needed};
    end

    memory #(.WIDTH(16), .DEPTH(COMPARTMENTS / 8)) groups (
        .clk,
        .write        (done && (last || done_place == LAST_IN_GROUP)),
        .write_address(done_group),
        .write_data   (with_done),
        .read         (unknown || (issue && place == LAST_IN_GROUP)),
        .read_address (unknown ? group : group + 1'b1),  // a late word of this group, or the next group's ahead of time
        .read_data    (group_bits)
    );

    always_ff @(posedge clk) begin
        {issued1, unknown1, place1, bits1} <= {issue, unknown, place, bits};
        if (done) collected <= with_done;
    end
endmodule
