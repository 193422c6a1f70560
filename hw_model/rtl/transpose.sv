// The buffer of a recording's events: a bit for every channel and step. Events set theirs while they arrive; phases other
// than the first play from here.
//
// A phase reads by visits, by rows, or both. In a visit a channel is read whole, at a step of its own: an event of row r
// is then a spike of source `first + r`. By rows, an event of channel c in row r is a spike of source `row_source + c` at
// step r. An aligned phase counts rows from the first with enough events on; by rows, it ends with the recording.
module transpose #(
    parameter integer BITMAP = 1024,
    parameter integer VISITS = 128,
    parameter integer SOURCE = 11
) (
    input  logic                      clk,
    input  logic                      clear,
    input  logic                      load_visit,
    input  logic [23:0]               load_address,
    input  logic [127:0]              load_data,
    // Of the program.
    input  logic [23:0]               kept,          // rows of a recording that are kept here, the first ones
    input  logic [23:0]               channels,
    input  logic [23:0]               row_words,     // words of a channel
    input  logic [23:0]               row_shift,     // of which a channel's place takes 2^row_shift
    input  logic [23:0]               align_events,  // events of the row that aligned phases begin with; 0: none does
    // Of the phase.
    input  logic [23:0]               steps,
    input  logic [23:0]               visits_end,    // its visits end before this one
    input  logic [23:0]               rows,          // that its visits tell of; of the recording, where it is aligned by rows
    input  logic [23:0]               row_source,
    input  logic                      by_rows,
    input  logic                      aligned,
    input  logic                      mark,
    input  logic                      mark_first,    // the first of its step
    input  logic [15:0]               mark_channel,
    input  logic [23:0]               mark_step,
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
    localparam integer ROW = PLACE + 6;  // bits of a row, and of one before the first: a word has 32
    localparam integer STEP = 16;
    localparam integer VISIT = STEP + PLACE + SOURCE;
    localparam integer INDEX = $clog2(VISITS);

    // Reading. IDLE; FETCH and HOLD: the first visit is read; COMPARE: is its step now? NEXT: the rows of this step, a visit
    // that is due, or the step ends; CHANNEL: a channel of this row is read, another looked at; PRIME: the first word of a
    // visit is read, and the next visit; SCAN: an event for each bit of a word, while the next word waits.
    //
    // What is found waits for its turn in a register, and all stands still until then. From there it leaves as a word.
    localparam logic [2:0] IDLE = 0, FETCH = 1, HOLD = 2, COMPARE = 3, NEXT = 4, CHANNEL = 5, PRIME = 6, SCAN = 7;
    logic [2:0]        state;
    logic              due, over, row_done;
    logic [INDEX:0]    index;
    logic [STEP-1:0]   step;
    logic [ROW-1:0]    row;           // of this step
    logic [PLACE:0]    words_left, channel;
    logic              word_is, bits_are;  // of channels by rows: `word` and `bits` hold one
    logic [PLACE-1:0]  place;
    logic [SOURCE-1:0] source;
    logic [ROW-1:0]    word_row;      // the row of the lowest of `bits`; by rows, the channel that was looked at last
    logic [31:0]       bits, word;
    logic              fetched;
    logic [VISIT-1:0]  visit_word, visit;
    wire [STEP-1:0]    visit_step = visit[STEP-1:0];
    wire [PLACE-1:0]   visit_place = visit[STEP+:PLACE];
    wire [SOURCE-1:0]  visit_source = visit[STEP+PLACE+:SOURCE];
    logic              found, found_visited;
    logic [1:0]        found_kind;
    logic [4:0]        found_bit;
    wire               go = !found || !out_valid;  // whether a word is taken is known too late in a cycle
    wire               next_word = state == SCAN && bits == 0 && words_left != 0;
    wire               next_channel = state == CHANNEL && channel != channels[PLACE:0];

    // The first row with enough events.
    logic [16:0]    together;
    logic [ROW-1:0] touch;
    logic           touched;
    wire [16:0]     so_far = mark_first ? 17'd1 : together + 17'd1;
    wire [ROW-1:0]  origin = !aligned ? {ROW{1'b0}} : touched ? touch : kept[ROW-1:0];
    always_ff @(posedge clk) begin
        if (mark) begin
            together <= so_far;
            if (so_far == align_events[16:0] && !touched) {touched, touch} <= {1'b1, mark_step[ROW-1:0]};
        end
        if (clear) touched <= 0;
    end

    // Marking takes three cycles: read the word, set a bit of it in `bits`, write it. Words of the stream come in every other
    // cycle, and a channel is marked once in a step, so a word is not marked twice in a row.
    logic             mark1, mark2;
    logic [PLACE-1:0] mark_place1, mark_place2;
    logic [31:0]      mark_bit1;  // 0 where nothing is marked
    wire [31:0]       marked = word | mark_bit1;
    wire [PLACE-1:0]  mark_place = PLACE'({8'b0, mark_channel} << row_shift[3:0]) | mark_step[5+:PLACE];
    wire              marking = mark && mark_step < kept;

    memory #(.WIDTH(32), .DEPTH(BITMAP)) bitmap (
        .clk,
        .write        (mark2),
        .write_address(mark_place2),
        .write_data   (bits),
        .read         (marking || (go && (state == PRIME || next_word || next_channel))),
        .read_address (state == IDLE ? mark_place : place),
        .read_data    (word)
    );
    memory #(.WIDTH(VISIT), .DEPTH(VISITS)) visit_list (
        .clk,
        .write        (load_visit),
        .write_address(load_address[INDEX-1:0]),
        .write_data   (load_data[VISIT-1:0]),
        .read         (go && (state == FETCH || state == PRIME)),
        .read_address (index[INDEX-1:0]),
        .read_data    (visit_word)
    );

    wire [31:0]    lowest = bits & (~bits + 1);
    wire [4:0]     lowest_index = {|(lowest & 32'hffff0000), |(lowest & 32'hff00ff00), |(lowest & 32'hf0f0f0f0),
                                   |(lowest & 32'hcccccccc), |(lowest & 32'haaaaaaaa)};
    wire           hit = bits_are && bits[row[4:0]];
    wire [ROW-1:0] event_row = word_row + ROW'(found_bit);

    always_ff @(posedge clk) begin
        // Between recordings every word is written with no bit.
        {mark1, mark2} <= clear ? {1'b0, sweep} : {marking, mark1};
        mark_place1 <= mark_place;
        mark_place2 <= sweep ? sweep_address : mark_place1;
        mark_bit1 <= marking ? 32'b1 << mark_step[4:0] : 32'b0;
        over <= step == steps[STEP-1:0] || (by_rows && aligned && row == rows[ROW-1:0]);
        fetched <= go && (state == FETCH || state == PRIME);
        if (fetched) visit <= visit_word;
        if (out_ready) out_valid <= 0;
        if (go) begin
            found <= 0;
            if (found) begin
                // Before the first row it wraps, to a large number.
                out_valid <= !found_visited || event_row < rows[ROW-1:0];
                out_kind <= found_kind;
                out_source <= source + SOURCE'(event_row);
            end
            case (state)
                IDLE: begin
                    bits <= marked;
                    if (start) state <= FETCH;
                    {step, row_done} <= 0;
                    row <= origin;
                end
                FETCH: state <= HOLD;
                HOLD: state <= COMPARE;
                COMPARE: begin
                    due <= {{(23-INDEX){1'b0}}, index} != visits_end && visit_step == step;
                    state <= NEXT;
                end
                NEXT:
                if (by_rows && !over && !row_done) begin
                    source <= row_source[SOURCE-1:0];
                    place <= row[5+:PLACE];
                    word_row <= {ROW{1'b1}};
                    channel <= 0;
                    {word_is, bits_are} <= 0;
                    row_done <= 1;
                    state <= CHANNEL;
                end else if (due) begin
                    {place, source} <= {visit_place, visit_source};
                    word_row <= ~origin - ROW'(31);  // 32 rows before -origin
                    words_left <= row_words[PLACE:0];
                    index <= index + 1;
                    bits <= 0;
                    state <= PRIME;
                end else begin
                    found <= 1;
                    found_visited <= 0;
                    found_kind <= over ? END : TICK;
                    step <= step + 1;
                    row <= row + 1;
                    row_done <= 0;
                    state <= over ? IDLE : COMPARE;
                end
                CHANNEL: begin
                    place <= place + (PLACE'(1) << row_shift[3:0]);
                    if (next_channel) channel <= channel + 1;
                    {bits_are, word_is} <= {word_is, next_channel};
                    bits <= marked;
                    {found, found_visited, found_kind, found_bit} <= {hit, 1'b0, EVENT, 5'd0};
                    if (bits_are) word_row <= word_row + 1;
                    if (!next_channel && !word_is) state <= NEXT;
                end
                PRIME: begin
                    place <= place + 1;
                    state <= SCAN;
                end
                default:
                if (bits != 0) begin
                    {found, found_visited, found_kind, found_bit} <= {1'b1, 1'b1, EVENT, lowest_index};
                    bits <= bits & ~lowest;
                end else if (words_left != 0) begin
                    bits <= marked;
                    word_row <= word_row + 32;
                    place <= place + 1;
                    words_left <= words_left - 1;
                end else state <= COMPARE;
            endcase
        end
        if (clear) begin
            state <= IDLE;
            {out_valid, found} <= 0;
            {index, bits} <= 0;
        end
    end

    wire unused = &{1'b0, load_address, load_data, steps, rows, channels, row_words, row_shift, row_source, align_events};
endmodule
