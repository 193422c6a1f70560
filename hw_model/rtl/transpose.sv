// The buffer of a recording's events: one bit for every channel and row, where a row is a step of the recording. While the
// recording arrives, every event sets its bit. All phases but the first get their events from here: row by row as they came,
// or transposed, channel by channel.
//
// A word has WORD rows of one channel. The words of the same rows follow each other, channel by channel, so the next rows of a
// channel are `channels` words further on.
//
// A phase reads the buffer in one of two ways, or in both:
//
//     by visits   a visit reads all rows of one channel, in the step of the phase that the program gives it. An event of row r
//                 spikes as source `first + r`, or as `first + r / 2^shared` where so many rows share a source.
//     by rows     step r reads row r, channel by channel. An event of channel c spikes as `row_source + c`.
//
// A phase that is aligned counts rows from the first row with `align_events` events. By visits, earlier rows do not spike; by
// rows, the phase begins with that row and ends with the last row of the recording.
//
// Words for the sequencer leave as from event_input.sv: an event with its source, a tick after each step, an end after the last.
//
// Reading is a state machine:
//
//     IDLE      the recording arrives; or the last phase has been read, and `start` begins the next
//     FETCH     the first visit of the phase is asked for
//     HOLD      the memory shows it
//     COMPARE   is the next visit due in this step?
//     NEXT      what follows: the channels of this row, the visit that is due, or the end of the step
//     CHANNEL   by rows: each cycle asks for the word of a channel, and looks at the row's bit of the one two channels before
//     PRIME     the first word of the visited channel is asked for, and the visit after this one
//     SCAN      each cycle finds the lowest bit that is left of a word; without any, the next word of the channel comes
//
// An event, tick or end that was found waits in the registers `pending*`, in the next cycle becomes a word at the output, and
// there waits to be taken. All else stands still while both are full (`go` is low).
module transpose #(
    parameter integer BITMAP = 1024,  // words of the buffer
    parameter integer WORD = 32,  // rows of a word, a power of two
    parameter integer VISITS = 128,  // visits of channels, of all phases together
    parameter integer SOURCE = 11,  // bits of the number of a source
    parameter integer ONE_PORT = 0,  // 1: the buffer is a memory of one port
    parameter integer FAST = 0,  // 1: shorter paths, for more logic
    parameter integer GROUPS = 0  // 1: rows of a visit may share a source
) (
    input  logic                      clk,
    input  logic                      clear,
    input  logic                      load_visit,
    input  logic [23:0]               load_address,
    input  logic [127:0]              load_data,
    // Settings of the program.
    input  logic [23:0]               kept,          // rows of a recording that are kept here, the first ones
    input  logic [23:0]               channels,
    input  logic [23:0]               words,         // that the kept rows of all channels take
    input  logic [23:0]               align_events,  // events of the row that aligned phases begin with; 0: no phase is aligned
    // Fields of the phase.
    input  logic [23:0]               steps,
    input  logic [23:0]               visits_end,    // the number of the visit behind its last one
    input  logic [23:0]               rows,          // rows whose events visits play; aligned and by rows: rows of the recording
    input  logic [2:0]                shared,        // 2^shared of the rows that visits play are one source
    input  logic [23:0]               row_source,    // the source of channel 0, by rows
    input  logic                      by_rows,
    input  logic                      aligned,
    // From the stream: an event of a channel, which stays in the next cycle, and the end of a row.
    input  logic                      mark,
    input  logic [SOURCE-1:0]         mark_channel,
    input  logic                      mark_tick,
    input  logic                      sweep,         // between recordings: sets the word to 0
    input  logic [$clog2(BITMAP)-1:0] sweep_address,
    input  logic                      start,         // a phase other than the first begins
    output logic                      out_valid,
    input  logic                      out_ready,
    output logic [1:0]                out_kind,
    output logic [SOURCE-1:0]         out_source
);
    localparam logic [1:0] EVENT = 0, TICK = 1, END = 2;
    localparam integer PLACE = $clog2(BITMAP);
    localparam integer BIT = $clog2(WORD);
    localparam integer ROW = PLACE + BIT + 1;  // bits of the number of a row; one more than rows need, for numbers below 0
    localparam integer STEP = 16;
    localparam integer VISIT = STEP + 2 * SOURCE;  // bits of a visit, from bit 0: step, channel, source of its first row
    localparam integer INDEX = $clog2(VISITS);

    // Reading; the head of this file says what the states do.
    localparam logic [2:0] IDLE = 0, FETCH = 1, HOLD = 2, COMPARE = 3, NEXT = 4, CHANNEL = 5, PRIME = 6, SCAN = 7;
    logic [2:0]        state;
    logic              due, steps_over, row_done;  // a visit is due in this step; no step is left; this row was read by channels
    logic [INDEX:0]    index;         // the number of the next visit
    logic [STEP-1:0]   step;          // of the phase
    logic [ROW-1:0]    row;           // the row of this step; while the recording arrives, the row that arrives
    logic [PLACE-1:0]  row_place;     // the address of this row's word of channel 0
    logic [SOURCE:0]   channel;       // by rows: the channel whose word is asked for
    logic              word_is, bits_are;  // by rows: `word`, `bits` hold the word of a channel
    logic [PLACE:0]    place;         // by visits: the address of the next word of the channel
    logic              more;          // by visits: `word` is the next word of the channel; there is none where it is low
    logic [SOURCE-1:0] source;        // of the first row of the visit, or of channel 0 by rows
    // The row of the lowest bit of `bits`; by rows, the channel that was looked at last. Both begin before 0, so that the first
    // word makes it 0.
    logic [ROW-1:0]    word_row;
    logic [WORD-1:0]   bits, word;    // a word that is being looked at, and the one that the memory shows
    logic              fetched;       // the memory shows a visit that was asked for
    logic [VISIT-1:0]  visit_word, visit;
    wire [STEP-1:0]    visit_step = visit[STEP-1:0];
    wire [SOURCE-1:0]  visit_channel = visit[STEP+:SOURCE];
    wire [SOURCE-1:0]  visit_source = visit[STEP+SOURCE+:SOURCE];
    logic              pending, pending_visited;  // a word waits; it comes from a visit, not from a channel by rows
    logic [1:0]        pending_kind;
    logic [BIT-1:0]    pending_bit;
    // Whether the word at the output is taken is known too late in a cycle to go on in the same one.
    wire               go = !pending || !out_valid;
    // The next word is asked for.
    wire               next_word = state == SCAN && bits == 0 && more;
    wire               next_channel = state == CHANNEL && channel != channels[SOURCE:0];

    // Marking: the bit of an event is set in three cycles.
    //
    //     cycle 0   `marking`: the channel's word of the row is read
    //     cycle 1   `marked`: the memory shows it, and the row's bit is set in it
    //     cycle 2   `write_back`: it is written
    //
    // Words of the stream come in every other cycle at most, and a channel is marked once in a row, so the next mark reads another
    // word, and need not wait for this one to be written. A memory of one port cannot read and write in one cycle: it is written
    // in cycle 1, before the next mark is read in cycle 2. This makes a longer path, for a slower clock.
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

    // The row that aligned phases begin with. `touched`: the first row with enough events came, or the recording is over;
    // touch_row and touch_place then stay as they are. `never`: no row had enough, which touch_row cannot say, as the phase may
    // have more rows than the recording, and would begin with a row that did not come.
    logic [SOURCE:0]  events_in_row;
    logic             counted, touched, never;  // `counted`: a mark is in events_in_row since this cycle
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

    // The lowest bit that is set, alone, and its number: x & -x, where -x is ~x + 1.
    wire [WORD-1:0] lowest = bits & (~bits + 1'b1);
    logic [BIT-1:0] lowest_index;
    always_comb begin
        lowest_index = 0;
        for (integer i = 0; i < WORD; i = i + 1) if (lowest[i]) lowest_index = lowest_index | BIT'(i);
    end
    wire [ROW-1:0] next_row = word_row + (state == CHANNEL ? ROW'(1) : ROW'(WORD));
    wire           hit = bits_are && bits[row[BIT-1:0]];  // by rows: the channel has an event in this row
    wire [ROW-1:0] origin = aligned && pending_visited ? touch_row : {ROW{1'b0}};
    // By rows pending_bit is 0, and this is the channel. A row before the first of an aligned phase wraps to a large number, which
    // is not below `rows`, so its event does not leave.
    wire [ROW-1:0] event_row = (word_row | ROW'(pending_bit)) - origin;
    wire           row_next = by_rows && !steps_over && !row_done;
    wire           row_over = state == IDLE ? mark_tick && !full : go && state == NEXT && !row_next && !due;

    always_ff @(posedge ticking) begin
        steps_over <= step == steps[STEP-1:0] || (by_rows && aligned && (never || row == rows[ROW-1:0]));
        fetched <= go && (state == FETCH || state == PRIME);
        if (fetched) visit <= visit_word;
        if (out_ready) out_valid <= 0;
        if (row_over) begin
            row <= row + 1;
            if (&row[BIT-1:0]) row_place <= row_place + channels[PLACE-1:0];  // the last row of a word
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
                    word_row <= {ROW{1'b1}};  // -1: one channel before channel 0
                    channel <= 0;
                    {word_is, bits_are} <= 0;
                    row_done <= 1;
                    state <= CHANNEL;
                end else if (due) begin
                    source <= visit_source;
                    place <= (PLACE + 1)'(visit_channel);
                    word_row <= {{(ROW-BIT){1'b1}}, {BIT{1'b0}}};  // -WORD: one word before row 0
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
                default:  // SCAN
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
