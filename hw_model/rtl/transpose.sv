// The buffer of a recording's events: a bit for every channel and row. Events set theirs while they arrive; phases other
// than the first play from here.
//
// A word has WORD rows of a channel. Words of the same rows follow each other, channel by channel, so the next rows of a
// channel are `channels` words away.
//
// A phase reads by visits, by rows, or both. A visit reads a channel whole, at its own step: an event of row r spikes as
// source `first + r`, or `first + r / 2^k` where so many rows share one. By rows, an event of channel c in row r spikes as
// `row_source + c` at step r. An aligned phase counts from the first row with enough events; by rows, it ends with the last.
module transpose #(
    parameter integer BITMAP = 1024,
    parameter integer WORD = 32,  // a power of two
    parameter integer VISITS = 128,
    parameter integer SOURCE = 11,
    parameter integer ONE_PORT = 0,  // 1: the buffer is a memory of one port
    parameter integer FAST = 0,  // 1: shorter paths, for more logic
    parameter integer GROUPS = 0  // 1: rows of a visit may share a source
) (
    input  logic                      clk,
    input  logic                      clear,
    input  logic                      load_visit,
    input  logic [23:0]               load_address,
    input  logic [127:0]              load_data,
    // Of the program.
    input  logic [23:0]               kept,          // rows of a recording that are kept here, the first ones
    input  logic [23:0]               channels,
    input  logic [23:0]               words,         // that these rows take
    input  logic [23:0]               align_events,  // events of the row that aligned phases begin with; 0: none does
    // Of the phase.
    input  logic [23:0]               steps,
    input  logic [23:0]               visits_end,    // the number of the visit behind its last one
    input  logic [23:0]               rows,          // that its visits tell of; aligned by rows: of the recording
    input  logic [2:0]                shared,        // 2^shared of these rows are one source
    input  logic [23:0]               row_source,
    input  logic                      by_rows,
    input  logic                      aligned,
    // Of the stream: an event of a channel, which stays in the next cycle, and the end of a row.
    input  logic                      mark,
    input  logic [SOURCE-1:0]         mark_channel,
    input  logic                      mark_tick,
    input  logic                      sweep,
    input  logic [$clog2(BITMAP)-1:0] sweep_address,
    input  logic                      start,
    output logic                      out_valid,
    input  logic                      out_ready,
    output logic [1:0]                out_kind,
    output logic [SOURCE-1:0]         out_source
);
    localparam logic [1:0] EVENT = 0, TICK = 1, END = 2;
    localparam integer PLACE = $clog2(BITMAP);
    localparam integer BIT = $clog2(WORD);
    localparam integer ROW = PLACE + BIT + 1;  // bits of a row, and of one before the first
    localparam integer STEP = 16;
    localparam integer VISIT = STEP + 2 * SOURCE;
    localparam integer INDEX = $clog2(VISITS);

    // Reading. IDLE; FETCH and HOLD: the first visit is read; COMPARE: is its step now? NEXT: the rows of this step, a visit
    // that is due, or the step ends; CHANNEL: a channel of this row is read, another looked at; PRIME: the first word of a
    // visit is read, and the next visit; SCAN: an event for each bit of a word, while the next word waits.
    //
    // A word that was found, `pending`, waits in a register until the output is free; all else stands still until then.
    localparam logic [2:0] IDLE = 0, FETCH = 1, HOLD = 2, COMPARE = 3, NEXT = 4, CHANNEL = 5, PRIME = 6, SCAN = 7;
    logic [2:0]        state;
    logic              due, steps_over, row_done;  // a visit is due in this step; no step is left; this row was read by channels
    logic [INDEX:0]    index;
    logic [STEP-1:0]   step;
    logic [ROW-1:0]    row;           // of this step; of the stream while it arrives
    logic [PLACE-1:0]  row_place;     // where its words begin
    logic [SOURCE:0]   channel;
    logic              word_is, bits_are;  // of channels by rows: `word` and `bits` hold one
    logic [PLACE:0]    place;         // of the next word of a visit
    logic              more;          // `word` is one of this visit
    logic [SOURCE-1:0] source;
    logic [ROW-1:0]    word_row;      // the row of the lowest of `bits`; by rows, the channel that was looked at last
    logic [WORD-1:0]   bits, word;
    logic              fetched;
    logic [VISIT-1:0]  visit_word, visit;
    wire [STEP-1:0]    visit_step = visit[STEP-1:0];
    wire [SOURCE-1:0]  visit_channel = visit[STEP+:SOURCE];
    wire [SOURCE-1:0]  visit_source = visit[STEP+SOURCE+:SOURCE];
    logic              pending, pending_visited;  // a word waits; it comes from a visit, not from a channel by rows
    logic [1:0]        pending_kind;
    logic [BIT-1:0]    pending_bit;
    wire               go = !pending || !out_valid;  // whether a word is taken is known too late in a cycle
    wire               next_word = state == SCAN && bits == 0 && more;
    wire               next_channel = state == CHANNEL && channel != channels[SOURCE:0];

    // Marking takes three cycles: read the word, set a bit of it, write it. Words of the stream come in every other cycle at
    // most, and a channel is marked once in a step, so a word is not marked twice in a row.
    // A memory of one port is written in the second cycle, before the next mark is read: a longer path, of a slower clock.
    logic              marked, write_back;
    logic [PLACE-1:0]  write_place;
    logic [WORD-1:0]   write_word;
    wire               marking = mark && !full;
    wire [SOURCE-1:0]  row_channel = state == IDLE ? mark_channel : channel[SOURCE-1:0];
    wire [PLACE-1:0]   address = sweep ? sweep_address
        : state == IDLE || state == CHANNEL ? row_place + PLACE'(row_channel) : place[PLACE-1:0];
    logic [WORD-1:0]   written;
    always_comb begin
        written = word;
        written[row[BIT-1:0]] = 1;
        if (sweep) written = 0;
    end

    wire               write = ONE_PORT != 0 ? marked || sweep : write_back;

    // The first row with enough events, or that none has them: where phases keep more rows than the recording has, the last
    // row that came does not tell.
    logic [SOURCE:0]  events_in_row;
    logic             counted, touched, never;
    logic [ROW-1:0]   touch_row;
    logic [PLACE-1:0] touch_place;
    logic             was_full, row_began;
    wire              full = FAST != 0 ? was_full : row == kept[ROW-1:0];
    wire              ticking;  // while a word is marked, or looked for
    always_ff @(posedge clk) row_began <= mark_tick;  // the first cycle of a row
    clock_gate gate (
        .clk, .enable(clear || load_visit || start || mark || counted || marked || write_back || mark_tick || row_began || out_ready
            || (go && (state != IDLE || pending))), .gated(ticking)
    );
    always_ff @(posedge ticking) begin
        {counted, marked} <= clear ? 2'b0 : {mark, marking};
        was_full <= row == kept[ROW-1:0];  // no word comes in the cycle after a tick
        write_back <= marked || sweep;
        {write_place, write_word} <= {address, written};
        if (mark) events_in_row <= events_in_row + 1;
        if (!touched && state == IDLE) {touch_row, touch_place} <= {row, row_place};
        if (start || (counted && events_in_row == align_events[SOURCE:0])) touched <= 1;
        if (mark_tick || clear) events_in_row <= 0;
        if (start && !touched) never <= 1;
        if (clear) {touched, never} <= 0;
    end

    memory #(.WIDTH(WORD), .DEPTH(BITMAP)) bitmap (
        .clk          (ticking),
        .write,
        .write_address(ONE_PORT != 0 ? address : write_place),
        .write_data   (ONE_PORT != 0 ? written : write_word),
        .read         (!(ONE_PORT != 0 && write) && (marking || (go && (state == PRIME || next_word || next_channel)))),
        .read_address (address),
        .read_data    (word)
    );
    memory #(.WIDTH(VISIT), .DEPTH(VISITS)) visit_list (
        .clk          (ticking),
        .write        (load_visit),
        .write_address(load_address[INDEX-1:0]),
        .write_data   (load_data[VISIT-1:0]),
        .read         (go && (state == FETCH || state == PRIME)),
        .read_address (index[INDEX-1:0]),
        .read_data    (visit_word)
    );

    wire [WORD-1:0] lowest = bits & (~bits + 1'b1);
    logic [BIT-1:0] lowest_index;
    always_comb begin
        lowest_index = 0;
        for (integer i = 0; i < WORD; i = i + 1) if (lowest[i]) lowest_index = lowest_index | BIT'(i);
    end
    wire [ROW-1:0] next_row = word_row + (state == CHANNEL ? ROW'(1) : ROW'(WORD));
    wire           hit = bits_are && bits[row[BIT-1:0]];
    wire [ROW-1:0] origin = aligned && pending_visited ? touch_row : {ROW{1'b0}};
    wire [ROW-1:0] event_row = (word_row | ROW'(pending_bit)) - origin;  // before the first row it wraps, to a large number
    wire           row_next = by_rows && !steps_over && !row_done;
    wire           row_over = state == IDLE ? mark_tick && !full : go && state == NEXT && !row_next && !due;

    always_ff @(posedge ticking) begin
        steps_over <= step == steps[STEP-1:0] || (by_rows && aligned && (never || row == rows[ROW-1:0]));
        fetched <= go && (state == FETCH || state == PRIME);
        if (fetched) visit <= visit_word;
        if (out_ready) out_valid <= 0;
        if (row_over) begin
            row <= row + 1;
            if (&row[BIT-1:0]) row_place <= row_place + channels[PLACE-1:0];
        end
        if (go) begin
            pending <= 0;
            if (pending) begin
                out_valid <= !pending_visited || event_row < rows[ROW-1:0];
                out_kind <= pending_kind;
                out_source <= source + SOURCE'(GROUPS != 0 && pending_visited ? event_row >> shared : event_row);
            end
            case (state)
                IDLE:
                if (start) begin
                    state <= FETCH;
                    {step, row_done} <= 0;
                    row <= aligned ? touch_row : {ROW{1'b0}};
                    row_place <= aligned ? touch_place : {PLACE{1'b0}};
                end
                FETCH: state <= HOLD;
                HOLD: state <= COMPARE;
                COMPARE: begin
                    due <= index != visits_end[INDEX:0] && visit_step == step;
                    state <= NEXT;
                end
                NEXT:
                if (row_next) begin
                    source <= row_source[SOURCE-1:0];
                    word_row <= {ROW{1'b1}};
                    channel <= 0;
                    {word_is, bits_are} <= 0;
                    row_done <= 1;
                    state <= CHANNEL;
                end else if (due) begin
                    source <= visit_source;
                    place <= (PLACE + 1)'(visit_channel);
                    word_row <= {{(ROW-BIT){1'b1}}, {BIT{1'b0}}};
                    index <= index + 1;
                    bits <= 0;
                    state <= PRIME;
                end else begin
                    pending <= 1;
                    pending_visited <= 0;
                    pending_kind <= steps_over ? END : TICK;
                    step <= step + 1;
                    row_done <= 0;
                    state <= steps_over ? IDLE : COMPARE;
                end
                CHANNEL: begin
                    if (next_channel) channel <= channel + 1;
                    {bits_are, word_is} <= {word_is, next_channel};
                    bits <= word;
                    {pending, pending_visited, pending_kind, pending_bit} <= {hit, 1'b0, EVENT, {BIT{1'b0}}};
                    if (bits_are) word_row <= next_row;
                    if (!next_channel && !word_is) state <= NEXT;
                end
                PRIME: begin
                    more <= place < words[PLACE:0];
                    place <= place + channels[PLACE:0];
                    state <= SCAN;
                end
                default:
                if (bits != 0) begin
                    {pending, pending_visited, pending_kind, pending_bit} <= {1'b1, 1'b1, EVENT, lowest_index};
                    bits <= bits & ~lowest;
                end else if (more) begin
                    bits <= word;
                    word_row <= next_row;
                    more <= place < words[PLACE:0];
                    place <= place + channels[PLACE:0];
                end else state <= COMPARE;
            endcase
        end
        if (clear) begin
            state <= IDLE;
            {out_valid, pending} <= 0;
            {index, row, row_place} <= 0;
        end
    end

    wire unused = &{1'b0, load_address, load_data, kept, channels, words, align_events, steps, visits_end, rows, shared,
        row_source, row_channel};
endmodule
