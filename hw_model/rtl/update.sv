// The step of a compartment. A pipeline takes one compartment per cycle, and needs nine cycles from its number to its new state:
//
//     q = charge that is due, wrapped to 21 bits plus sign
//     u = rz(u, decay_u) + q, wrapped to 23 bits plus sign
//     v = rz(v, decay_v) + (u + bias, wrapped to 23 bits plus sign) + joined voltages, clipped to vmin..vmax
//     spike where v > 64 * threshold; then v = 0 and the compartment is blocked for some steps, with v held at 0
//
// The joined voltages of a compartment are the sum of v of its children in this step; a child never spikes (join_sums.sv).
//
// u, v, q and bias are in units of the registers; charges arrive, and thresholds are stored, in units of 64 of them. A decay
// d is a fraction d / 4096, and rz(x, d) is what it leaves of x (leak.sv). Widths are those of hw_model/chips/loihi-sim.yaml.
//
// Bias, decays and the like are constants of the compartment, in two memories: `leaks` is read at the beginning, `fires` (limits,
// threshold, readout) later, when it is needed, so that its words need fewer registers.
//
// A digit at the end of a name is the cycle to which a signal belongs, counted from the one in which the compartment is issued:
//
//     0  number: state, constants of the leak and charge are read       5  add bias; add joined voltages
//     1  they arrive                                                    6  v is their sum
//     2  products of u and v with 4096 - decay                          7  clip v, compare
//     3  their sums                                                     8  write the state, tell of the spike
//     4  add q to u; constants of clip and threshold are read
module update #(
    parameter integer COMPARTMENTS = 512,
    parameter integer STATES = COMPARTMENTS,  // words of the memory of states; fewer than compartments where phases share them
    parameter integer CHARGE = 18,  // bits of a charge, in units of 64, sign included
    parameter integer JOIN = 26,  // bits of a sum of joined voltages, sign included; 0: compartments are not joined
    parameter integer ENTRIES = 128,  // compartments that are read out
    parameter integer LAZY = 0, // 1: a state that the next step does not depend on is neither read nor written (at_rest.sv)
    // Words for sums of joined voltages; 0: one per state. The low bits of a parent's place select its word.
    parameter integer SUMS = 0
) (
    input  logic                            clk,
    input  logic                            clear,
    input  logic                            load_leak,
    input  logic                            load_fire,
    input  logic [23:0]                     load_address,
    input  logic [127:0]                    load_data,
    input  logic                            issue,       // the step of compartment `number` begins
    // The first step of the phase, until its last compartment is done: states are taken for 0, whatever the memory holds.
    input  logic                            first_step,
    input  logic [$clog2(COMPARTMENTS)-1:0] number,
    input  logic [$clog2(COMPARTMENTS)-1:0] origin,      // the compartment whose state lies first
    // The charge that is due, two cycles after its compartment was issued, in units of 64.
    input  logic [CHARGE-1:0]               charge,
    output logic                            busy,        // a compartment is in the pipeline
    // Results of a compartment, in the last of its cycles (`done`); its number comes a cycle earlier, too.
    output logic [$clog2(COMPARTMENTS)-1:0] early_number,
    output logic                            done,
    output logic [$clog2(COMPARTMENTS)-1:0] done_number,
    output logic                            fired,
    output logic signed [23:0]              done_u,
    output logic signed [23:0]              done_v,
    output logic signed [23:0]              potential,  // v before it is set to 0 by a spike
    output logic                            active,     // there was something to work on: a charge, state, bias or joined voltage
    output logic                            charge_wrap,
    output logic [1:0]                      current_wraps,  // how many of u and u + bias wrapped
    output logic                            voltage_clip,
    // Its entry of the readout: whether it has one and its number two cycles before the end, so that it can be read.
    output logic                            early_read,
    output logic [$clog2(ENTRIES)-1:0]      early_entry,
    output logic                            read_out,
    output logic                            by_potential,
    output logic [$clog2(ENTRIES)-1:0]      entry
);
    localparam integer NUMBER = $clog2(COMPARTMENTS);
    localparam integer ENTRY = $clog2(ENTRIES);  // bits of an entry: the number of a compartment's tally in readout.sv
    // Words of memories 3 and 4 (docs/reference/hardware/stream-and-memory-map.md): valid, 4096 - decay_u, 4096 - decay_v,
    // bias, has children; threshold, blocked steps, can spike, log2 of 1 - vmin, log2 of vmax + 1, then what follows
    // where compartments are joined (is a child, is the first of its siblings, parent), read out, by potential, entry.
    localparam integer LEAK = 1 + 13 + 13 + 20 + 1;
    localparam integer PLACE = $clog2(STATES);
    localparam integer SUM_WORDS = SUMS != 0 ? SUMS : STATES;
    localparam integer PARENT = $clog2(SUM_WORDS);
    localparam integer FIRE_FIELDS = 17 + 6 + 1 + 5 + 5;
    localparam integer JOIN_FIELDS = JOIN != 0 ? 2 + PARENT : 0;
    localparam integer FIRE = FIRE_FIELDS + JOIN_FIELDS + 2 + ENTRY;
    // A state is u and v of 24 bits each, and six bits of steps to stay blocked; with LAZY these take the place of v.
    localparam integer STATE = LAZY != 0 ? 48 : 54;
    localparam integer JOINED = JOIN != 0 ? JOIN : 24;
    localparam integer V_SUM = JOIN != 0 ? JOIN + 2 : 25;  // bits that v needs before it is clipped: a sum of three, or of two

    wire               pipeline_clock;  // while a compartment is on its way
    // Bit n - 1: cycle n has a number. It is not `valid` where the number is of no compartment, a gap that lets a parent wait
    // for its children.
    logic [7:0]        issued;
    logic              valid2, valid3, valid4, valid5, valid6, valid7, valid8;
    logic [NUMBER-1:0] number3, number4, number7, number8;
    logic              first1;

    always_ff @(posedge pipeline_clock) begin
        issued <= clear ? 8'b0 : {issued[6:0], issue};
        first1 <= first_step;
        {number4, number8} <= {number3, number7};
        {valid3, valid4, valid5, valid6, valid7, valid8} <= clear ? 6'b0 : {valid2, valid3, valid4, valid5, valid6, valid7};
    end
    // The numbers of a step follow each other. With LAZY they are counted anew at cycles 3 and 7, so that fewer registers change
    // than if every number moved from cycle to cycle.
    generate
        if (LAZY != 0) begin : counted
            logic [NUMBER-1:0] begins;  // the first number of a run of cycles without a pause
            always_ff @(posedge pipeline_clock) begin
                // After a pause, `begins` is loaded anew. A pipeline without a pause counts on from the number before.
                if (issue && !issued[0]) begins <= number;
                number3 <= issued[2] ? number3 + 1'b1 : begins;
                number7 <= issued[6] ? number7 + 1'b1 : begins;
            end
        end else begin : handed_on
            logic [NUMBER-1:0] number1, number2, number5, number6;
            always_ff @(posedge pipeline_clock) begin
                {number1, number2, number3} <= {number, number1, number2};
                {number5, number6, number7} <= {number4, number5, number6};
            end
        end
    endgenerate
    assign busy = |issued;
    assign early_number = number7;
    clock_gate gate (.clk, .enable(issue || busy || clear || load_leak || load_fire), .gated(pipeline_clock));

    // Where the state of a compartment lies.
    wire [PLACE-1:0] place0 = PLACE'(number - origin), place3 = PLACE'(number3 - origin), place8 = PLACE'(number8 - origin);

    // 0 and 1: state and constants of the leak. With LAZY, a blocked compartment, whose voltage is 0, has the steps for which it
    // stays blocked stored in the place of the voltage. Its bits in at_rest.sv tell it from others: `needed` without `nonzero`.
    logic [STATE-1:0]   state_word1;
    wire                read0, needed1, nonzero1;
    wire                was_blocked1 = LAZY != 0 && needed1 && !nonzero1;
    wire [53:0]         state1 = !needed1 ? 54'b0 : was_blocked1 ? {state_word1[29:24], 24'b0, state_word1[23:0]} : 54'(state_word1);
    logic [LEAK-1:0]    leak1;
    wire signed [23:0]  u1, v1;
    wire [5:0]          blocked1;
    wire                valid_word1, has_children1;
    wire [12:0]         keep_u1, keep_v1;
    wire signed [19:0]  bias1;
    assign {blocked1, v1, u1} = first1 ? 54'b0 : state1;
    assign {has_children1, bias1, keep_v1, keep_u1, valid_word1} = leak1;
    logic [53:0]        new_state8;
    wire                stays_blocked8 = new_state8[53:48] != 0;
    wire                changed8, needed8;

    memory #(.WIDTH(STATE), .DEPTH(STATES)) states (
        .clk(pipeline_clock),
        .write(valid8 && (LAZY != 0 ? needed8 : changed8)), .write_address(place8),
        .write_data(LAZY != 0 && stays_blocked8 ? STATE'({new_state8[53:48], u8}) : new_state8[STATE-1:0]),
        .read(read0 && !(LAZY != 0 && first_step)), .read_address(place0), .read_data(state_word1)
    );
    memory #(.WIDTH(LEAK), .DEPTH(COMPARTMENTS)) leaks (
        .clk(pipeline_clock),
        .write(load_leak), .write_address(load_address[NUMBER-1:0]), .write_data(load_data[LEAK-1:0]),
        .read(issue), .read_address(number), .read_data(leak1)
    );

    // Only a state that was written goes through the leak. For others the registers of the leak keep old values to save
    // energy, and what the leak makes of them is replaced by 0; `leaks1` to `leaks4`: the state was written.
    // `lasting`: a decay leaves a part of u or v after a step.
    wire  leaks1 = LAZY == 0 || (needed1 && !first1);
    logic leaks2, leaks3, leaks4, nonzero2, was_blocked2, lasting2, lasting3, lasting4, lasting5, lasting6, lasting7, lasting8;
    always_ff @(posedge pipeline_clock) begin
        {leaks2, leaks3, leaks4} <= {leaks1, leaks2, leaks3};
        nonzero2 <= nonzero1 && !first1;
        was_blocked2 <= was_blocked1 && !first1;
        lasting2 <= keep_u1 != 0 || keep_v1 != 0;
        {lasting3, lasting4, lasting5, lasting6, lasting7, lasting8}
            <= {lasting2, lasting3, lasting4, lasting5, lasting6, lasting7};
    end
    assign needed8 = stays_blocked8 || (lasting8 && new_state8[47:0] != 0);
    generate
        if (LAZY != 0) begin : lazy
            at_rest #(.COMPARTMENTS(STATES)) resting (
                .clk(pipeline_clock), .issue, .number(place0), .read(read0), .needed(needed1), .nonzero(nonzero1),
                .done(issued[7]), .last(!issued[6]), .done_number(place8),
                .done_needed(valid8 && needed8), .done_nonzero(valid8 && !stays_blocked8 && new_state8[47:0] != 0)
            );
        end else begin : eager
            assign {read0, needed1, nonzero1} = {issue, 2'b11};
        end
    endgenerate

    // 2: the charge is here. It wraps to 22 bits; in units of 64 these are 16, so it has wrapped where the bits above differ from
    // the sign at bit 15.
    logic signed [23:0] u2, v2;
    logic [5:0]         blocked2, blocked3, blocked4, blocked5, blocked6, blocked7, blocked8;
    logic [12:0]        keep_u2, keep_v2;
    logic signed [19:0] bias2, bias3, bias4, bias5;
    logic               has_children2, has_children3, has_children4;
    wire                wrap2 = charge[CHARGE-1:15] != {(CHARGE-15){charge[15]}};
    wire                nonzero_state2 = LAZY != 0 ? nonzero2 || (was_blocked2 && u2 != 0) : u2 != 0 || v2 != 0;
    wire                active2 = charge != 0 || nonzero_state2 || bias2 != 0;

    always_ff @(posedge pipeline_clock) begin
        valid2 <= !clear && issued[0] && valid_word1;
        {blocked2, bias2} <= {blocked1, bias1};
        if (leaks1) {u2, v2, keep_u2, keep_v2} <= {u1, v1, keep_u1, keep_v1};
        {blocked3, blocked4, blocked5} <= {blocked2, blocked3, blocked4};
        {blocked6, blocked7, blocked8} <= {blocked5, blocked6, blocked7};
        {bias3, bias4, bias5} <= {bias2, bias3, bias4};
        {has_children2, has_children3, has_children4} <= {has_children1, has_children2, has_children3};
    end

    // A compartment is `live` in a cycle if its current, voltage or what is added to them may be other than 0. Registers that hold
    // 0 and would load 0 again get no clock, to save energy. While memories are cleaned (`clear`) they are clocked, which replaces
    // what they held before the first recording.
    wire signed [JOINED-1:0]  joined4;
    logic signed [JOINED-1:0] joined5;
    logic live3, live4, live5, live6, live7, live8;
    wire  live2 = leaks2 || charge != 0 || bias2 != 0;
    wire  joins5 = joined5 != 0;
    wire  clock3, clock4, clock5, clock_joined5, clock6, clock7, clock8;
    always_ff @(posedge pipeline_clock) begin
        {live3, live4, live5} <= {live2, live3, live4};
        {live6, live7, live8} <= {live5 || joins5, live6, live7};
    end
    clock_gate gate3 (.clk(pipeline_clock), .enable(live2 || live3 || clear), .gated(clock3));
    clock_gate gate4 (.clk(pipeline_clock), .enable(live3 || live4 || clear), .gated(clock4));
    clock_gate gate5 (.clk(pipeline_clock), .enable(live4 || live5 || clear), .gated(clock5));
    clock_gate gate_joined5 (.clk(pipeline_clock), .enable(has_children4 || joins5 || clear), .gated(clock_joined5));
    clock_gate gate6 (.clk(pipeline_clock), .enable(live5 || joins5 || live6 || clear), .gated(clock6));
    clock_gate gate7 (.clk(pipeline_clock), .enable(live6 || live7 || clear), .gated(clock7));
    clock_gate gate8 (.clk(pipeline_clock), .enable(live7 || live8 || clear), .gated(clock8));

    // 2 to 4: the leak.
    wire               leaking;
    wire signed [23:0] leak_u4, leak_v4;
    wire signed [23:0] left_u4 = leaks4 || LAZY == 0 ? leak_u4 : 24'sd0, left_v4 = leaks4 || LAZY == 0 ? leak_v4 : 24'sd0;
    clock_gate leak_gate (.clk(pipeline_clock), .enable(leaks2 || leaks3), .gated(leaking));
    leak leak_u (.clk(leaking), .x(u2), .keep(keep_u2), .left(leak_u4));
    leak leak_v (.clk(leaking), .x(v2), .keep(keep_v2), .left(leak_v4));

    logic signed [15:0] charge3, charge4;
    logic               wrap3, wrap4, wrap5, wrap6, wrap7, wrap8;
    logic               active3, active4, active5, active6, active7, active8;
    always_ff @(posedge pipeline_clock) begin
        {wrap3, wrap4, wrap5, wrap6, wrap7, wrap8} <= {wrap2, wrap3, wrap4, wrap5, wrap6, wrap7};
        {active3, active4, active5} <= {active2, active3, active4};
    end
    always_ff @(posedge clock3) charge3 <= charge[15:0];
    always_ff @(posedge clock4) charge4 <= charge3;

    // 4: u is what the leak left, plus the charge (6'b0: from units of 64 to those of u). 25 bits hold their sum; u keeps 24.
    wire signed [24:0]  sum4 = {left_u4[23], left_u4} + {{3{charge4[15]}}, charge4, 6'b0};
    logic signed [23:0] u5, u6, u7, u8, left_v5;
    logic               u_wrap5, u_wrap6, u_wrap7, u_wrap8;
    always_ff @(posedge pipeline_clock) begin
        u_wrap5 <= sum4[24] != sum4[23];
    end
    always_ff @(posedge clock5) {u5, left_v5} <= {sum4[23:0], left_v4};
    always_ff @(posedge clock6) u6 <= u5;
    always_ff @(posedge clock7) u7 <= u6;
    always_ff @(posedge clock8) u8 <= u7;
    always_ff @(posedge clock_joined5) joined5 <= has_children4 ? joined4 : {JOINED{1'b0}};

    // 5: the drive of v is u and bias, wrapped likewise; `rest` is what else is added up to v: what the leak left, and joined
    // voltages.
    wire signed [24:0]     drive5 = {u5[23], u5} + {{5{bias5[19]}}, bias5};
    logic signed [23:0]    drive6;
    logic                  drive_wrap6, drive_wrap7, drive_wrap8;
    logic signed [V_SUM-1:0] rest6;
    always_ff @(posedge pipeline_clock) begin
        drive_wrap6 <= drive5[24] != drive5[23];
        {u_wrap6, u_wrap7, u_wrap8, drive_wrap7, drive_wrap8} <= {u_wrap5, u_wrap6, u_wrap7, drive_wrap6, drive_wrap7};
        active6 <= active5 || joins5;
        {active7, active8} <= {active6, active7};
    end
    always_ff @(posedge clock6) begin
        drive6 <= drive5[23:0];
        rest6 <= {{(V_SUM-23){left_v5[23]}}, left_v5[22:0]} + {{(V_SUM-JOINED){joined5[JOINED-1]}}, joined5};
    end

    // 5 and 6: constants of clip and threshold. Limits are 1 - 2^vmin_log and 2^vmax_log - 1.
    logic [FIRE-1:0]    fire5, fire6, fire7, fire8;
    wire [4:0]          vmin_log6 = fire6[28:24];
    wire [4:0]          vmax_log6 = fire6[33:29];
    logic signed [23:0] vmin7, vmax7;
    // For each group of four bits of a limit: whether the logarithm is above the group (`fours`), or within it (`four`). Every bit
    // of the limit then needs a few inputs only.
    (* keep *) logic [5:0] vmin_fours, vmin_four, vmax_fours, vmax_four;
    always_comb for (integer i = 0; i < 6; i = i + 1) begin
        {vmin_fours[i], vmin_four[i]} = {vmin_log6[4:2] > 3'(i), vmin_log6[4:2] == 3'(i)};
        {vmax_fours[i], vmax_four[i]} = {vmax_log6[4:2] > 3'(i), vmax_log6[4:2] == 3'(i)};
    end
    memory #(.WIDTH(FIRE), .DEPTH(COMPARTMENTS)) fires (
        .clk(pipeline_clock),
        .write(load_fire), .write_address(load_address[NUMBER-1:0]), .write_data(load_data[FIRE-1:0]),
        .read(valid4), .read_address(number4), .read_data(fire5)
    );
    always_ff @(posedge pipeline_clock) begin
        {fire6, fire7, fire8} <= {fire5, fire6, fire7};
        for (integer i = 0; i < 24; i = i + 1) begin
            vmin7[i] <= vmin_log6 != 0 && (i == 0 || !(vmin_fours[i/4] || (vmin_four[i/4] && vmin_log6[1:0] > 2'(i))));
            vmax7[i] <= vmax_fours[i/4] || (vmax_four[i/4] && vmax_log6[1:0] > 2'(i));
        end
    end
    assign early_entry = fire6[FIRE-1:FIRE-ENTRY];
    assign early_read = valid6 && fire6[FIRE-ENTRY-2];

    // 6: v. 7: clip it.
    logic signed [V_SUM-1:0] sum7;
    wire signed [V_SUM-1:0]  low7 = {{(V_SUM-23){vmin7[23]}}, vmin7[22:0]};
    wire                   below7 = sum7 < low7;
    // The upper limit is 2^k - 1: a positive sum is above it exactly if it has a bit outside of it.
    wire                   beyond7 = !sum7[V_SUM-1] && (sum7 & ~{{(V_SUM-24){1'b0}}, vmax7}) != 0;
    logic signed [23:0]    clipped8;
    logic                  clip8, above8;
    always_ff @(posedge clock7) sum7 <= rest6 + {{(V_SUM-23){drive6[23]}}, drive6[22:0]};
    always_ff @(posedge clock8) clipped8 <= below7 ? vmin7 : beyond7 ? vmax7 : sum7[23:0];
    always_ff @(posedge pipeline_clock) begin
        // The sum is compared before it is clipped, to save a cycle. Limits do not matter: the lower one is never above a
        // threshold, and where the upper one is not above it, the loader says that the compartment does not spike (`spiking`).
        above8 <= $signed({{(V_SUM-23){1'b0}}, fire7[16:0], 6'b0}) < sum7;
        clip8 <= below7 || beyond7;
    end

    // 8: fire.
    wire [16:0]       threshold8;
    wire [5:0]        blocks8;
    wire              spiking8, read_out8, by_potential8;
    wire [4:0]        vmin_log8, vmax_log8;
    wire [ENTRY-1:0]  entry8;
    assign {vmax_log8, vmin_log8, spiking8, blocks8, threshold8} = fire8[FIRE_FIELDS-1:0];
    assign {entry8, by_potential8, read_out8} = fire8[FIRE-1:FIRE_FIELDS+JOIN_FIELDS];
    logic is_blocked8;
    always_ff @(posedge pipeline_clock) is_blocked8 <= blocked7 != 0;

    assign fired = valid8 && spiking8 && !is_blocked8 && above8;
    assign potential = is_blocked8 ? 24'd0 : clipped8;
    assign done_v = fired ? 24'd0 : potential;
    assign done_u = u8;
    assign new_state8 = {fired ? blocks8 : is_blocked8 ? blocked8 - 6'd1 : 6'd0, done_v, u8};
    // The state of a compartment at rest is not written, as it stays the same; that of a first step is, as the memory holds what an
    // earlier recording left.
    assign changed8 = active8 || is_blocked8 || first_step;
    assign done = valid8;
    assign done_number = number8;
    assign active = active8;
    assign charge_wrap = wrap8;
    assign current_wraps = {1'b0, u_wrap8} + {1'b0, drive_wrap8 && !is_blocked8};
    assign voltage_clip = clip8 && !is_blocked8;
    assign read_out = valid8 && read_out8;
    assign by_potential = by_potential8;
    assign entry = entry8;

    generate
        if (JOIN != 0) begin : families
            wire              child8, first_child8;
            wire [PARENT-1:0] parent8;
            assign {parent8, first_child8, child8} = fire8[FIRE_FIELDS+:JOIN_FIELDS];
            wire sibling7 = valid7 && fire7[FIRE_FIELDS+:2] == 2'b01;  // a child, and not the first
            join_sums #(.WIDTH(JOIN), .COMPARTMENTS(SUM_WORDS)) joins (
                // A child does not fire. Siblings follow each other, and only the sum of all is written: `last` is 0 if the next
                // compartment is another sibling. Without LAZY, each child writes the sum so far.
                .clk(pipeline_clock), .child(valid8 && child8), .last(LAZY == 0 || !sibling7),
                .first(first_child8), .parent(parent8), .v(clipped8),
                .read(valid3 && has_children3), .read_address(place3[PARENT-1:0]), .joined(joined4)
            );
        end else begin : alone
            assign joined4 = {JOINED{1'b0}};
            wire unused_place = &{1'b0, place3, has_children3};
        end
    endgenerate

    wire unused = &{1'b0, load_address, load_data, threshold8, vmin_log8, vmax_log8};
endmodule
