// One core that runs a whole program: a recording streams in, its class comes out.
//
//     in  -> event_input ----.                       .-> update -> readout -> answer
//               | marks      |-> words -> sequencer -|     | spikes
//               `-> transpose                        |     v
//                                       requests ->  delivery <- queue
//
// Phases follow each other: the first runs while the recording arrives, all others read the buffer of its events (transpose).
// A step of a phase is: deliver its input spikes, update every compartment of the phase, deliver the spikes of those that
// fired. Charges of step t go to the slots of t + 1 and later, so the order of deliveries does not matter.
//
// Some words: A row is what a recording holds for one step of its own time, the events between two ticks. A phase that reads
// rows from the buffer has steps of another kind, and may take the rows in another order. A source is whatever sends spikes:
// a channel of the recording, a row of a visit (transpose.sv), or a compartment; each has a list of synapses. A slot is a place
// for the charges of one step to come. docs/reference/glossary.md has the words of all pages.
//
// The sequencer is the state machine in the middle of this file. Its states:
//
//     STOPPED   after a reset, until the setting RUN is written
//     CLEAN     all memories with state are swept, a word per cycle
//     PHASE     the eight fields of the next phase are read; before that, charges are swept where phases share places
//     ROW       words are taken: an event is delivered, a tick begins the updates, an end finishes the phase
//     UPDATE    the compartments of the phase are updated, one per cycle
//     SPIKES    until all updates are done and all spikes of the step delivered
//     READOUT   after the last phase: the scores of the classes
//     ANSWER    until the host takes the answer; then CLEAN for the next recording
//
// Memories are filled through the load port, between recordings; setting RUN, the last one, cleans all state and starts.
// State is cleaned after every recording, answered or stopped. The layouts of all words are in
// docs/reference/hardware/stream-and-memory-map.md.
module locsnn_core #(
    parameter integer AXONS = 2048,         // sources: channels, rows of visits and compartments, all that send spikes
    parameter integer SYNAPSES = 16384,     // two per word
    parameter integer COMPARTMENTS = 512,
    parameter integer SLOTS = 16,           // a power of two, at least the longest delay and 2
    parameter integer CHARGE = 18,          // bits of a charge under way, in units of 64, sign included
    parameter integer JOIN = 26,            // bits of a sum of joined voltages, sign included; 0: compartments are not joined
    parameter integer BITMAP = 1024,        // words of the buffer of events
    parameter integer VISITS = 128,         // visits of channels, of all phases together
    parameter integer ENTRIES = 128,        // compartments that are read out
    parameter integer WORD = 32,            // rows of a word of the buffer, a power of two
    parameter integer PHASE_WORDS = 512,    // eight for each phase; a power of two, at most 512
    // What makes memories smaller on a chip; each is off where it is 0.
    parameter integer STEP = 0,             // bits in which a list stores a target, as the step from the one before (stepped.sv)
    parameter integer PLACES = 0,           // phases share this many places for states and charges, a power of two: a compartment's
                                            // place is its distance from the first compartment of its phase
    parameter integer SUMS = 0,             // words for sums of joined voltages, a power of two, that parents share
    // Bits of slots more, in charge memory that a program of few compartments leaves unused. With them, the second phase
    // hears its events when they arrive, not later from the buffer: each event becomes a charge of the step of its visit.
    parameter integer LATER = 0,
    // 1: up to 2^7 rows of a visit may share a source, where their lists are the same.
    parameter integer GROUPS = 0,
    // 1: the buffer is a memory of one port, so a marked word is written a cycle earlier, before the next mark is read.
    parameter integer ONE_PORT = 0,
    // What saves energy on a chip, and costs logic elsewhere.
    parameter integer AT_ONCE = 0,          // 1: the memory of charges answers at once, as in accumulator_at_once.sv
    parameter integer LAZY = 0              // 1: states that do not matter are neither read nor written, as at_rest.sv says
) (
    input  logic               clk,
    input  logic               reset,
    input  logic               load_valid,
    input  logic [2:0]         load_memory,   // 0 settings, 1 axons, 2 synapses, 3 leaks, 4 fires, 5 visits, 6 weights, 7 phases
    input  logic [23:0]        load_address,
    input  logic [127:0]       load_data,
    input  logic               in_valid,
    output logic               in_ready,
    input  logic [1:0]         in_kind,     // 0 event, 1 tick, 2 end, 3 stop
    input  logic [15:0]        in_channel,
    input  logic               hold,        // no further step begins; for hosts that take spikes slowly
    output logic               answer_valid,
    input  logic               answer_ready,
    output logic [2:0]         answer_error,  // 0: none; see event_input
    output logic [15:0]        answer_class,
    // What the recording made the core do (activity.sv).
    output logic [31:0]        answer_synapses,
    output logic [31:0]        answer_updates,
    output logic [31:0]        answer_active_updates,
    output logic [31:0]        answer_spikes,
    output logic [31:0]        answer_charge_wraps,
    output logic [31:0]        answer_current_wraps,
    output logic [31:0]        answer_voltage_clips,
    // For test benches: the results of every update while `probe_valid` is high, and every score.
    output logic                            probe_valid,
    output logic [$clog2(COMPARTMENTS)-1:0] probe_compartment,
    output logic [23:0]                     probe_u,
    output logic [23:0]                     probe_v,
    output logic [23:0]                     probe_potential,
    output logic                            probe_fired,
    output logic                            probe_active,
    output logic                            probe_charge_wrap,
    output logic [1:0]                      probe_current_wraps,
    output logic                            probe_voltage_clip,
    output logic                            probe_score_valid,
    output logic [63:0]                     probe_score
);
    // Bits of the number of a source, a compartment, a slot, the slot of a request (delivery.sv), a tally, a word of phases.
    localparam integer SOURCE = $clog2(AXONS);
    localparam integer NUMBER = $clog2(COMPARTMENTS);
    localparam integer SLOT = $clog2(SLOTS) + LATER;
    localparam integer BASE = LATER != 0 ? SLOT + 1 : SLOT;
    localparam integer ENTRY = $clog2(ENTRIES);
    localparam integer PHASE_WORD = $clog2(PHASE_WORDS);
    localparam integer STATES = PLACES != 0 ? PLACES : COMPARTMENTS;  // compartments whose state is held at a time
    localparam integer PLACE = $clog2(STATES);
    localparam integer ADDRESS = $clog2(SLOTS) + PLACE - 1;  // of a charge in its bank: two banks share the places
    // Between recordings all memories with state are swept at once, by one counter with the bits of the largest.
    localparam integer SWEPT = ADDRESS > $clog2(BITMAP) ? ADDRESS : $clog2(BITMAP);
    localparam integer SWEEPING = SWEPT > ENTRY ? SWEPT : ENTRY;

    // Shorter paths, for more logic: on a chip and on a large device, where memories are far apart.
    localparam integer FAST = LATER != 0 || LAZY != 0 ? 1 : 0;

    // Settings: memory 0 of the load port. hw_model/rtl/images.py writes them in this order.
    localparam integer ROWS_HEARD = 0;    // rows that the first phase plays; 0: as many as the recording has
    localparam integer ROWS_KEPT = 1;     // first rows of a recording, which the buffer keeps
    localparam integer CHANNELS = 2;      // of a recording
    localparam integer BUFFER_WORDS = 3;  // that the kept rows of all channels take
    localparam integer ALIGN_EVENTS = 4;  // events of the row from which aligned phases count; 0: no phase is aligned
    localparam integer PHASES = 5;
    localparam integer SLOT_MASK = 6;     // slots in use, less one; bit 23: the second phase hears events when they arrive
    localparam integer SWEEP = 7;         // the address at which a sweep of all memories ends
    localparam integer CLASSES = 8;
    localparam integer POPULATIONS = 9;   // that are read out
    localparam integer FIRST_SOURCE = 10; // the source of compartment 0; those of the others follow
    localparam integer RUN = 11;          // written last: starts the core
    logic [23:0] settings[0:15];
    wire         load_setting = load_valid && load_memory == 0;
    wire         run = load_setting && {8'b0, load_address} == RUN;
    wire         settings_clock;
    clock_gate settings_gate (.clk, .enable(load_setting), .gated(settings_clock));
    always_ff @(posedge settings_clock) if (load_setting && !run) settings[load_address[3:0]] <= load_data[23:0];

    // Fields of a phase: memory 7, eight words per phase. In state PHASE they are read one by one, each pushing the others on:
    // field n is asked for while `field` is n and arrives in the next cycle, so the last is in its place once `field` is 9.
    localparam integer STEPS = 0, NUMBER_END = 1, VISITS_END = 2, ROWS = 3, ROW_SOURCE = 4, POTENTIALS_FROM = 5,
        BY_ROWS = 6, ALIGNED = 7;
    logic [23:0] phase_fields[0:7];
    logic [5:0]  phase;
    logic [3:0]  field;
    wire [23:0]  next_field;

    // Sequencer; the head of this file says what its states do.
    localparam logic [2:0] STOPPED = 0, CLEAN = 1, PHASE = 2, ROW = 3, UPDATE = 4, SPIKES = 5, READOUT = 6, ANSWER = 7;
    localparam logic [1:0] EVENT = 0, TICK = 1;
    logic [2:0]        state;
    logic [23:0]       next_step;   // how many steps of the phase there are once this one is over
    logic              first_step;
    logic              from_here;   // this is the first step whose potentials are read out
    logic              after_here;  // an earlier step was the first whose potentials are read out
    logic [SLOT-1:0]   slot;        // of this step: what arrives in it was added here
    logic [SWEEPING:0] sweep_at;
    logic [NUMBER:0]   number, number_begin;  // the compartment to update; the first one of the phase
    wire [NUMBER:0]    number_end = phase_fields[NUMBER_END][NUMBER:0];
    logic              buffered;  // the phase is not the first
    wire               clear = reset || state == CLEAN;
    // Where phases share places, charges that the previous one left are swept before the next.
    wire              sweeping = PLACES != 0 && state == PHASE && field == 0 && buffered
        && sweep_at != settings[SWEEP][SWEEPING:0];
    memory #(.WIDTH(24), .DEPTH(PHASE_WORDS)) phases (
        .clk,
        .write(load_valid && load_memory == 7), .write_address(load_address[PHASE_WORD-1:0]), .write_data(load_data[23:0]),
        .read(state == PHASE), .read_address(PHASE_WORD'({phase, field[2:0]})), .read_data(next_field)
    );

    // Words for the sequencer come from the stream (event) in the first phase, from the buffer (line) in all others.
    wire              row = state == ROW && !hold;
    wire              event_valid, line_valid;
    wire [1:0]        event_kind, line_kind;
    wire [SOURCE-1:0] event_source, line_source;
    wire              word_valid = buffered ? line_valid : event_valid;
    wire [1:0]        word_kind = buffered ? line_kind : event_kind;
    wire [SOURCE-1:0] word_source = buffered ? line_source : event_source;
    wire              mark, mark_tick, stop, failed;
    wire [2:0]        error;
    wire              delivering, updating, delivery_ready, read_out_done;
    wire              head_valid, queue_empty;
    wire [SOURCE-1:0] head;
    // All steps of the phase were played. A recording may have more rows than the first phase has steps: their words are taken
    // without effect here, and reach the buffer.
    logic steps_over;
    // While compartments are on their way to fire, events of the next row are delivered, and their charges count from two
    // steps ahead, not one. All charges of this step were taken, so its slot is free for the longest delay of the next step.
    logic last_step;
    always_ff @(posedge clk) last_step <= next_step == phase_fields[STEPS];
    wire early = state == SPIKES && !head_valid && !last_step;
    // Spikes may be looked up before the last charge of the step is taken, as their charges are added five cycles after the
    // request (delivery.sv). `ending` is a register, so it is computed from the number of the cycle before: 6, not 5.
    logic ending;
    always_ff @(posedge clk) ending <= state == UPDATE && number + 6 >= number_end;
    wire spike = head_valid && (state == SPIKES || (state == UPDATE && ending));
    wire is_event = word_kind == EVENT, is_tick = word_kind == TICK;
    // The compartment whose state and charges lie first, and the place of the one that is updated.
    wire [NUMBER-1:0] origin = PLACES != 0 ? number_begin[NUMBER-1:0] : {NUMBER{1'b0}};
    wire [PLACE-1:0]  place = PLACE'(number[NUMBER-1:0] - origin);
    // Where the second phase hears its events when they arrive (`later`), each of its steps has a slot of its own, and the
    // first phase has the last slots. An event that both phases hear is delivered twice: first as a channel to the first
    // phase, then (`again`) as the source that arrivals.sv tells to the second.
    wire               later, later_ready, later_asks;
    wire [SOURCE-1:0]  later_source;
    wire [BASE-1:0]    later_base;
    wire [SLOT-1:0]    next_slot;
    wire [PLACE-1:0]   later_place;
    wire               later_bank;
    wire [ADDRESS-1:0] later_address;
    generate
        if (LATER != 0) begin : arrive
            assign later = settings[SLOT_MASK][23];
            wire [SLOT-1:0]   slot_mask = settings[SLOT_MASK][SLOT-1:0];
            wire              due, known;
            wire [15:0]       step;
            wire [SOURCE-1:0] source;
            logic             again;
            arrivals #(.VISITS(VISITS), .SOURCE(SOURCE)) arrived (
                .clk, .clear, .load_visit(load_valid && load_memory == 5), .load_address, .load_data,
                .kept(settings[ROWS_KEPT]), .mark, .mark_channel(event_source), .mark_tick,
                .due, .valid(known), .step, .source
            );
            // Whether this request is the last one of its event.
            wire asked = buffered || !later || !due || (again && known);
            assign later_ready = early ? is_event && delivery_ready && asked
                : row && (steps_over && (is_event || is_tick) || (is_event ? delivery_ready && asked : !delivering));
            assign later_asks = (early || (row && !steps_over)) && word_valid && is_event && !(again && !known);
            always_ff @(posedge clk)
                again <= !clear && !(word_valid && later_ready) && (again || (later_asks && delivery_ready && !asked));
            assign later_source = again ? source : word_source;
            assign later_base = again && !spike ? {1'b1, SLOT'(step) + SLOT'(1)}
                : {buffered, slot + (early ? SLOT'(2) : SLOT'(1))};
            assign next_slot = !later ? (slot + 1) & slot_mask : buffered ? slot + 1 : (slot + 1) | ~slot_mask;
            assign later_place = later ? place & {PLACE{1'b1}} >> LATER : place;
            assign later_address = {slot[SLOT-LATER-1:0], later_place[PLACE-1:1]
                | (PLACE - 1)'(slot[SLOT-1:SLOT-LATER]) << (PLACE - 1 - LATER)};
            // Banks are far apart where there is so much memory, so the bank of the next number is computed a cycle ahead.
            wire [NUMBER-1:0] following_number = state == UPDATE ? number[NUMBER-1:0] + 1'b1 : number_begin[NUMBER-1:0];
            wire [PLACE-1:0]  following_place = PLACE'(following_number - origin) & {PLACE{1'b1}} >> (later ? LATER : 0);
            logic             odd;
            always_ff @(posedge clk) odd <= ^following_place;
            assign later_bank = odd ^ slot[0];
            wire unused_step = &{1'b0, step};
        end else begin : replay
            assign {later, later_ready, later_asks, later_source, later_base, next_slot, later_place,
                later_bank, later_address} = 0;
        end
    endgenerate
    wire word_ready = LATER != 0 ? later_ready : early ? is_event && delivery_ready
        : row && (steps_over && (is_event || is_tick) || (is_event ? delivery_ready : !delivering));
    wire word_taken = word_valid && word_ready;
    wire phase_over = word_taken && !is_event && !is_tick;
    logic last_phase;
    always_ff @(posedge clk) last_phase <= {1'b0, phase} + 1 == settings[PHASES][6:0];

    always_ff @(posedge clk) begin
        case (state)
            CLEAN: begin
                sweep_at <= sweep_at + 1;
                if (sweep_at == settings[SWEEP][SWEEPING:0]) state <= PHASE;
                {phase, field, buffered} <= 0;
            end
            PHASE: begin
                if (field == 0) number_begin <= buffered ? number_end : {(NUMBER + 1){1'b0}};
                if (sweeping) sweep_at <= sweep_at + 1;
                else field <= field + 1;
                next_step <= 1;
                slot <= 0;
                first_step <= 1;
                from_here <= phase_fields[POTENTIALS_FROM] == 0;
                after_here <= 0;
                steps_over <= phase_fields[STEPS] == 0;
                if (field == 9) state <= ROW;
            end
            ROW: begin
                number <= number_begin;
                field <= 0;
                if (word_taken && is_tick && !steps_over) state <= number_begin == number_end ? SPIKES : UPDATE;
                if (phase_over) begin
                    state <= last_phase ? READOUT : PHASE;
                    phase <= phase + 1;
                    buffered <= 1;
                    if (PLACES != 0) sweep_at <= 0;
                end
            end
            UPDATE: begin
                number <= number + 1;
                if (number + 1 == number_end) state <= SPIKES;
            end
            SPIKES: if (!updating && queue_empty) begin
                next_step <= next_step + 1;
                first_step <= 0;
                from_here <= next_step == phase_fields[POTENTIALS_FROM];
                after_here <= after_here || from_here;
                steps_over <= last_step;
                slot <= LATER != 0 ? next_slot : (slot + 1) & settings[SLOT_MASK][SLOT-1:0];
                state <= ROW;
            end
            READOUT: if (read_out_done) state <= ANSWER;
            ANSWER: if (answer_ready) begin
                sweep_at <= 0;
                state <= CLEAN;
            end
            default: ;
        endcase
        if (failed) state <= ANSWER;
        if (stop || run) begin
            sweep_at <= 0;
            state <= CLEAN;
        end
        if (reset) state <= STOPPED;
    end
    wire fields_clock;
    clock_gate fields_gate (.clk, .enable(state == PHASE), .gated(fields_clock));
    always_ff @(posedge fields_clock) if (state == PHASE && field != 0 && field != 9)
        {phase_fields[0], phase_fields[1], phase_fields[2], phase_fields[3], phase_fields[4], phase_fields[5], phase_fields[6], phase_fields[7]}
            <= {phase_fields[1], phase_fields[2], phase_fields[3], phase_fields[4], phase_fields[5], phase_fields[6], phase_fields[7], next_field};
    assign answer_valid = state == ANSWER;
    assign answer_error = error;

    event_input #(.SOURCE(SOURCE)) events (
        .clk, .clear, .listen(!buffered && (state == ROW || state == UPDATE || state == SPIKES)),
        .steps(settings[ROWS_HEARD]), .channels(settings[CHANNELS]),
        .in_valid, .in_ready, .in_kind, .in_channel,
        .out_valid(event_valid), .out_ready(word_ready && !buffered), .out_kind(event_kind), .out_source(event_source),
        .mark, .mark_tick, .stop, .failed, .error
    );

    transpose #(.BITMAP(BITMAP), .WORD(WORD), .VISITS(VISITS), .SOURCE(SOURCE), .ONE_PORT(ONE_PORT), .FAST(FAST), .GROUPS(GROUPS)) buffer (
        .clk, .clear, .load_visit(load_valid && load_memory == 5), .load_address, .load_data,
        .kept(settings[ROWS_KEPT]), .channels(settings[CHANNELS]),
        .words(settings[BUFFER_WORDS]), .align_events(settings[ALIGN_EVENTS]),
        .steps(phase_fields[STEPS]), .visits_end(phase_fields[VISITS_END]), .rows(phase_fields[ROWS]), .shared(phase_fields[BY_ROWS][3:1]), .row_source(phase_fields[ROW_SOURCE]),
        .by_rows(phase_fields[BY_ROWS][0]), .aligned(phase_fields[ALIGNED][0]),
        .mark, .mark_channel(event_source), .mark_tick,
        .sweep(clear && 32'(sweep_at) < BITMAP), .sweep_address(sweep_at[$clog2(BITMAP)-1:0]),
        .start(state == PHASE && field == 9 && buffered),
        .out_valid(line_valid), .out_ready(word_ready && buffered), .out_kind(line_kind), .out_source(line_source)
    );

    // Spikes to deliver: of channels and rows while words are taken, and of compartments after their update.
    wire [1:0]             add;
    wire [2*ADDRESS-1:0]   add_address;
    wire [2*CHARGE-1:0]    add_charge, taken;
    wire                   fired;
    wire [NUMBER-1:0]      early_number, done_number;
    logic [SOURCE-1:0]     done_source;
    always_ff @(posedge clk) done_source <= SOURCE'(early_number) + settings[FIRST_SOURCE][SOURCE-1:0];

    queue #(.WIDTH(SOURCE), .DEPTH(STATES)) spikes (
        .clk, .clear, .push(fired), .pushed(done_source), .head_valid, .head,
        .pop(spike && delivery_ready), .empty(queue_empty)
    );

    delivery #(
        .AXONS(AXONS), .SYNAPSES(SYNAPSES), .COMPARTMENTS(STATES), .SLOTS(SLOTS), .CHARGE(CHARGE), .STEP(STEP), .LATER(LATER)
    ) deliver (
        .clk, .clear, .load_axon(load_valid && load_memory == 1), .load_synapse(load_valid && load_memory == 2),
        .load_address, .load_data,
        .request(LATER != 0 ? spike || later_asks : spike || ((early || (row && !steps_over)) && word_valid && is_event)),
        .ready(delivery_ready),
        .source(spike ? head : LATER != 0 ? later_source : word_source),
        .base(LATER != 0 ? later_base : BASE'(SLOT'(slot + (early ? SLOT'(2) : SLOT'(1))))),
        .slot_mask(settings[SLOT_MASK][SLOT-1:0]), .later,
        .add, .add_address, .add_charge, .busy(delivering)
    );

    // Charges under way, in two banks that add at the same time; an update takes the charge from the bank of its compartment.
    // A charge is `taken` two cycles after its request, so the number of its bank is delayed as much.
    wire  number_bank = LATER != 0 ? later_bank : ^{place, slot[0]};
    logic bank1, bank2;
    always_ff @(posedge clk) {bank1, bank2} <= {number_bank, bank1};
    wire [CHARGE-1:0] charge = bank2 ? taken[2*CHARGE-1:CHARGE] : taken[CHARGE-1:0];

    genvar bank;
    generate
        for (bank = 0; bank < 2; bank = bank + 1) begin : banks
            wire take = state == UPDATE && number_bank == bank;
            wire [ADDRESS-1:0] address = state == UPDATE ? (LATER != 0 ? later_address : ADDRESS'({slot, place[PLACE-1:1]}))
                : add_address[bank*ADDRESS+:ADDRESS];
            wire swept = (clear || sweeping) && 32'(sweep_at) < SLOTS * STATES / 2;
            if (AT_ONCE != 0) begin : at_once
                accumulator_at_once #(.WIDTH(CHARGE), .DEPTH(SLOTS * STATES / 2)) charges (
                    .clk, .valid(add[bank] || take), .take, .address, .addend(add_charge[bank*CHARGE+:CHARGE]),
                    .taken(taken[bank*CHARGE+:CHARGE]), .sweep(swept), .sweep_address(sweep_at[ADDRESS-1:0])
                );
            end else begin : in_turn
                accumulator #(.WIDTH(CHARGE), .DEPTH(SLOTS * STATES / 2)) charges (
                    .clk, .valid(add[bank] || take), .take, .address, .addend(add_charge[bank*CHARGE+:CHARGE]),
                    .taken(taken[bank*CHARGE+:CHARGE]), .sweep(swept), .sweep_address(sweep_at[ADDRESS-1:0])
                );
            end
        end
    endgenerate

    wire               done, active, charge_wrap, voltage_clip, early_read, read_out, by_potential;
    wire [1:0]         current_wraps;
    wire signed [23:0] done_u, done_v, potential;
    wire [ENTRY-1:0]   early_entry, entry;
    update #(
        .COMPARTMENTS(COMPARTMENTS), .STATES(STATES), .CHARGE(CHARGE), .JOIN(JOIN), .ENTRIES(ENTRIES), .LAZY(LAZY), .SUMS(SUMS)
    ) compartments (
        .clk, .clear, .load_leak(load_valid && load_memory == 3), .load_fire(load_valid && load_memory == 4),
        .load_address, .load_data,
        .issue(state == UPDATE), .first_step, .number(number[NUMBER-1:0]), .origin, .charge, .busy(updating),
        .early_number, .done, .done_number, .fired, .done_u, .done_v, .potential, .active, .charge_wrap, .current_wraps, .voltage_clip,
        .early_read, .early_entry, .read_out, .by_potential, .entry
    );

    readout #(.ENTRIES(ENTRIES), .FAST(FAST)) decide (
        .clk, .clear, .load_weight(load_valid && load_memory == 6), .load_address, .load_data,
        .classes(settings[CLASSES]), .populations(settings[POPULATIONS]),
        .from_here, .after_here,
        .sweep(clear && 32'(sweep_at) < ENTRIES), .sweep_address(sweep_at[ENTRY-1:0]),
        .early_read, .early_entry, .read_out, .by_potential, .entry, .fired, .potential,
        .start(phase_over && last_phase),
        .done(read_out_done), .winner(answer_class), .score_valid(probe_score_valid), .score(probe_score)
    );

    activity counts (
        .clk, .clear, .add, .update(done), .active, .fired, .charge_wrap, .current_wraps, .voltage_clip,
        .synapses(answer_synapses), .updates(answer_updates), .active_updates(answer_active_updates),
        .spikes(answer_spikes), .charges_wrapped(answer_charge_wraps), .currents_wrapped(answer_current_wraps),
        .voltages_clipped(answer_voltage_clips)
    );

    assign probe_valid = done;
    assign probe_compartment = done_number;
    assign {probe_u, probe_v, probe_potential} = {done_u, done_v, potential};
    assign {probe_fired, probe_active, probe_charge_wrap} = {fired, active, charge_wrap};
    assign {probe_current_wraps, probe_voltage_clip} = {current_wraps, voltage_clip};

    wire unused = &{1'b0, settings[PHASES], settings[SLOT_MASK], settings[FIRST_SOURCE], phase_fields[NUMBER_END], phase_fields[BY_ROWS],
        phase_fields[ALIGNED],
        later, later_ready, later_asks, later_source, later_base, next_slot, later_place, later_bank,
        later_address};
endmodule
