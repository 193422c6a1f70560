// Delivers spikes. A source is whatever sends spikes: a channel, a row of a visit, or a compartment. For each requested source
// this module looks up where its list of synapses lies, walks the list, a word per cycle, and hands each weight to the
// accumulators, for the slot of the step in which the weight is due.
//
//     cycle 0   `request` and `ready`: the axon memory is read
//     cycle 1   `list_valid`: the memory shows where the list begins and how many words it has
//     cycle 2   `walking`: the first word is asked for; the others follow, a word per cycle
//     cycle 3   `valid1`: the memory shows the word, late in the cycle
//     cycle 4   `valid2`: the word, from a register, is taken apart
//     cycle 5   `add`: an addition for each bank
//
// A word of a list has two synapses, one for each bank of charges; one of them may be missing. The two banks add at the same
// time. Bank 1 has the charges for which the bits of the compartment and the lowest bit of the slot hold an odd number of ones,
// so both banks get about as many, whatever the targets and delays of a list have in common. Which half of a word goes to
// which bank changes with every step, with the lowest bit of the base. An address in a bank leaves out the lowest bit of the
// compartment, which follows from the bank and the other bits.
//
// The next request is looked up while a list is walked, so a list of two words or more is followed by the next without a gap.
// A list of no synapses takes a cycle.
//
// With STEP, a target is stored as a step of so many bits from the target before it, which stepped.sv adds up: words are
// narrower, and the word of a list in the axon memory also holds the first target and the first exponent of the list.
//
// With LATER, memory that compartments do not need holds more slots: LATER bits more. locsnn_core.sv says what for. The base
// then has one bit more, at the top. Where it is set, the spike is for the second phase, and the slot is the number of one of
// its steps; the slots of the first phase are the last ones.
//
// A device with so much memory is large: a signal to all memories of synapses takes most of a cycle, and must come straight
// from a register. So with LATER these memories are written a cycle late, and for an empty list a word is read that is not used.
module delivery #(
    // Sizes of the core, as locsnn_core.sv has them.
    parameter integer AXONS = 2048,
    parameter integer SYNAPSES = 16384,
    parameter integer COMPARTMENTS = 512,
    parameter integer SLOTS = 16,
    parameter integer CHARGE = 18,
    parameter integer STEP = 0,
    parameter integer LATER = 0
) (
    input  logic                                        clk,
    input  logic                                        clear,
    input  logic                                        load_axon,
    input  logic                                        load_synapse,
    input  logic [23:0]                                 load_address,
    input  logic [127:0]                                load_data,
    // A spike of `source`; `base` is the slot of the step after the one in which it was fired, where a delay of 0 acts.
    input  logic                                        request,
    output logic                                        ready,
    input  logic [$clog2(AXONS)-1:0]                    source,
    input  logic [(LATER != 0 ? LATER + 1 : 0)+$clog2(SLOTS)-1:0] base,
    input  logic [LATER+$clog2(SLOTS)-1:0]              slot_mask,  // slots in use, less one: a slot wraps around at the last
    input  logic                                        later,      // the second phase hears events when they arrive
    // By bank: whether there is an addition; slot and compartment without its lowest bit; what is added, in units of 64.
    output logic [1:0]                                  add,
    output logic [2*($clog2(SLOTS)+$clog2(COMPARTMENTS)-1)-1:0] add_address,
    output logic [2*CHARGE-1:0]                         add_charge,
    output logic                                        busy
);
    localparam integer SYNAPSE_BITS = $clog2(SYNAPSES / 2);  // of an address: a word has two synapses
    localparam integer TARGET_BITS = $clog2(COMPARTMENTS) - 1;
    localparam integer SLOT_BITS = $clog2(SLOTS);
    localparam integer BASE = SLOT_BITS + (LATER != 0 ? LATER + 1 : 0);
    localparam integer ADDRESS = SLOT_BITS + TARGET_BITS;
    localparam integer SYNAPSE = TARGET_BITS + SLOT_BITS + 3 + 9;  // target, delay, exponent, mantissa with its sign
    localparam integer HALF = STEP != 0 ? STEP + SLOT_BITS + 9 : SYNAPSE;
    localparam integer WORD = 2 * HALF;
    // Bits of the words of a list. With STEP a list has at most 511 words; hw_model/rtl/refused.py refuses longer ones.
    localparam integer LENGTH = STEP != 0 && SYNAPSE_BITS > 9 ? 9 : SYNAPSE_BITS;
    localparam integer HEAD = TARGET_BITS + 3;  // with STEP: the first target of a list, and its first exponent
    localparam integer LIST = SYNAPSE_BITS + LENGTH + (STEP != 0 ? HEAD : 0);

    // Lookup: `list_valid` says that the axon memory shows the list of an accepted request.
    logic                      list_valid;
    logic [BASE-1:0]           list_base;
    logic [LIST-1:0]           list;
    wire  [SYNAPSE_BITS-1:0]   list_start = list[SYNAPSE_BITS-1:0];
    wire  [LENGTH-1:0]         list_length = list[SYNAPSE_BITS+:LENGTH];

    // Walk: `words_left` words of the current list from `word_at` on.
    logic                    walking;
    logic [SYNAPSE_BITS-1:0] word_at;
    logic [LENGTH-1:0]       words_left;
    logic [BASE-1:0]         walk_base;
    wire                     last = words_left <= 1;
    wire                     begin_list = list_valid && (!walking || last);
    assign ready = !list_valid;

    memory #(.WIDTH(LIST), .DEPTH(AXONS)) axons (
        .clk,
        .write        (load_axon),
        .write_address(load_address[$clog2(AXONS)-1:0]),
        .write_data   (load_data[LIST-1:0]),
        .read         (request && ready),
        .read_address (source),
        .read_data    (list)
    );

    always_ff @(posedge clk) begin
        if (request && ready) begin
            list_valid <= 1;
            list_base <= base;
        end else if (begin_list) list_valid <= 0;
        if (begin_list) begin
            walking <= 1;
            word_at <= list_start;
            words_left <= list_length;
            walk_base <= list_base;
        end else if (walking) begin
            if (last) walking <= 0;
            word_at <= word_at + 1;
            words_left <= words_left - 1;
        end
        if (clear) {list_valid, walking} <= 0;
    end

    // Synapses: read, kept in a register because memories answer late in the cycle, then made an operation per bank.
    logic                 walked1, walked2, valid1, valid2;
    logic [BASE-1:0]      base1, base2;
    logic [WORD-1:0]      word1, word2;

    logic                    load;
    logic [SYNAPSE_BITS-1:0] load_at;
    logic [WORD-1:0]         loaded;
    generate
        if (LATER != 0) begin : late
            always_ff @(posedge clk)
                {load, load_at, loaded} <= {load_synapse, load_address[SYNAPSE_BITS-1:0], load_data[WORD-1:0]};
        end else begin : at_once
            assign {load, load_at, loaded} = {load_synapse, load_address[SYNAPSE_BITS-1:0], load_data[WORD-1:0]};
        end
    endgenerate
    // Memories of small devices have one port: it is written between recordings, and read while they run.
    wire                    one_port = LATER == 0;
    wire [SYNAPSE_BITS-1:0] read_at = one_port && load ? load_at : word_at;

    memory #(.WIDTH(WORD), .DEPTH(SYNAPSES / 2)) synapses (
        .clk,
        .write        (load),
        .write_address(one_port ? read_at : load_at),
        .write_data   (loaded),
        .read         (walking && !(one_port && (words_left == 0 || load))),
        .read_address (read_at),
        .read_data    (word1)
    );

    always_ff @(posedge clk) begin
        {walked1, walked2} <= clear ? 2'b0 : {walking, walked1};
        {valid1, valid2} <= clear ? 2'b0 : {walking && words_left != 0, valid1};
        {base1, base2} <= {walk_base, base1};
        if (valid1) word2 <= word1;
    end

    // The synapses of a word, in full.
    wire [2*SYNAPSE-1:0] both;
    genvar half;
    generate
        if (STEP != 0) begin : steps
            // The head of a list follows its first word.
            logic            first, first1, first2;
            logic [HEAD-1:0] head, head1, head2;
            always_ff @(posedge clk) begin
                {first, first1, first2} <= {begin_list, first, first1};
                if (begin_list) head <= list[LIST-1-:HEAD];
                if (first) head1 <= head;
                if (first1) head2 <= head1;
            end
            for (half = 0; half < 2; half = half + 1) begin : halves
                stepped #(.STEP(STEP), .TARGET_BITS(TARGET_BITS), .SLOT_BITS(SLOT_BITS)) shown (
                    .clk, .valid(valid2), .first(first2), .head(head2), .half(word2[half*HALF+:HALF]),
                    .synapse(both[half*SYNAPSE+:SYNAPSE])
                );
            end
        end else begin : full
            assign both = word2;
        end
    endgenerate

    genvar bank;
    generate
        for (bank = 0; bank < 2; bank = bank + 1) begin : banks
            wire [TARGET_BITS-1:0] target;
            wire [SLOT_BITS-1:0]   delay;
            wire [2:0]             exponent;
            wire signed [8:0]      mantissa;
            assign {mantissa, exponent, delay, target} = base2[0] == bank ? both[SYNAPSE-1:0] : both[2*SYNAPSE-1:SYNAPSE];
            // A half without a synapse is stored as 0 * 2^7; a synapse of weight 0 is stored with exponent 0.
            wire used = mantissa != 0 || exponent != 7;
            wire signed [15:0] weight = {{7{mantissa[8]}}, mantissa};
            wire [15:0]        effective = weight <<< exponent;
            wire [ADDRESS-1:0] address_later;
            if (LATER != 0) begin : more_slots
                localparam integer ALL = SLOT_BITS + LATER;
                // Slots of the first phase are the last ones: their high bits stay ones while the low bits count in a ring.
                wire [ALL-1:0]         sum = base2[ALL-1:0] + ALL'(delay);
                wire [ALL-1:0]         slot = !later ? sum & slot_mask : base2[ALL] ? sum : sum | ~slot_mask;
                // The additional bits of the slot take the place of the highest bits of the target, which are 0.
                wire [TARGET_BITS-1:0] slot_high = TARGET_BITS'(slot[ALL-1:SLOT_BITS]) << (TARGET_BITS - LATER);
                assign address_later = {slot[SLOT_BITS-1:0], target | slot_high};
            end else begin : as_many
                assign address_later = 0;
            end
            // A spike of step t acts at step t + 1 + delay, with 64 * mantissa * 2^exponent; charges are in units of 64.
            always_ff @(posedge clk) begin
                add[bank] <= !clear && valid2 && used;
                if (valid2) begin
                    add_address[bank*ADDRESS+:ADDRESS]
                        <= LATER != 0 ? address_later : {(base2[SLOT_BITS-1:0] + delay) & slot_mask[SLOT_BITS-1:0], target};
                    add_charge[bank*CHARGE+:CHARGE] <= {{(CHARGE-15){effective[15]}}, effective[14:0]};
                end
            end
        end
    endgenerate
    assign busy = list_valid || walking || walked1 || walked2;

    wire unused = &{1'b0, load_address, load_data, later, slot_mask};
endmodule
