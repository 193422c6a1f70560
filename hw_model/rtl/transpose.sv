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
    localparam integer VISIT = 24 + PLACE + SOURCE;
    localparam integer INDEX = $clog2(VISITS);

    // Reading. IDLE; FETCH: a visit is read; COMPARE: is its step now? NEXT: the rows of this step, a visit that is due,
    // or the step ends; CHANNEL: a channel of this row; PRIME: the first word of a visit is read; SCAN: a spike for each
    // bit of a word, while the next word waits.
    localparam logic [2:0] IDLE = 0, FETCH = 1, COMPARE = 2, NEXT = 3, CHANNEL = 4, PRIME = 5, SCAN = 6;
    logic [2:0]        state;
    logic              due, over, row_done;
    logic [INDEX:0]    index;
    logic [23:0]       step, words_left, channel;
    logic [PLACE-1:0]  place;
    logic [SOURCE-1:0] source;
    logic [23:0]       word_row, next_row;  // the row of a word's lowest bit
    logic [31:0]       bits;
    logic [31:0]       word;
    logic [VISIT-1:0]  visit;
    wire [23:0]        visit_step = visit[23:0];
    wire [PLACE-1:0]   visit_place = visit[24+:PLACE];
    wire [SOURCE-1:0]  visit_source = visit[24+PLACE+:SOURCE];
    wire               free = !out_valid || out_ready;
    wire               next_word = state == SCAN && bits == 0 && words_left != 0;

    // The first row with enough events.
    logic [23:0] together, touch;
    logic        touched;
    wire  [23:0] so_far = mark_step == last_marked ? together + 1 : 24'd1;
    wire  [23:0] origin = !aligned ? 24'd0 : touched ? touch : kept;
    logic [23:0] last_marked;
    always_ff @(posedge clk) begin
        if (mark) begin
            {together, last_marked} <= {so_far, mark_step};
            if (so_far == align_events && !touched) {touched, touch} <= {1'b1, mark_step};
        end
        if (clear) {together, touched} <= 0;
    end

    // Marking takes two cycles: read the word, write it with one bit more. A channel is marked once in a step, so a word
    // is not marked twice in a row.
    logic             mark1;
    logic [PLACE-1:0] mark_place1;
    logic [31:0]      mark_bit1;
    wire [23:0]       mark_place = ({8'b0, mark_channel} << row_shift[4:0]) | {5'b0, mark_step[23:5]};
    wire              marking = mark && mark_step < kept;
    // By rows: `word` is that of the channel before this one.
    wire [23:0]       row = step + origin;
    wire [23:0]       row_place = (channel << row_shift[4:0]) | {5'b0, row[23:5]};
    wire              hit = channel != 0 && word[row[4:0]];
    wire              next_channel = state == CHANNEL && (!hit || free);

    memory #(.WIDTH(32), .DEPTH(BITMAP)) bitmap (
        .clk,
        .write        (mark1 || sweep),
        .write_address(sweep ? sweep_address : mark_place1),
        .write_data   (sweep ? 32'b0 : word | mark_bit1),
        .read         (marking || state == PRIME || next_word || next_channel),
        .read_address (state == IDLE ? mark_place[PLACE-1:0] : state == CHANNEL ? row_place[PLACE-1:0] : place),
        .read_data    (word)
    );
    memory #(.WIDTH(VISIT), .DEPTH(VISITS)) visit_list (
        .clk,
        .write        (load_visit),
        .write_address(load_address[INDEX-1:0]),
        .write_data   (load_data[VISIT-1:0]),
        .read         (state == FETCH),
        .read_address (index[INDEX-1:0]),
        .read_data    (visit)
    );

    wire [31:0] lowest = bits & (~bits + 1);
    wire [4:0]  lowest_index = {|(lowest & 32'hffff0000), |(lowest & 32'hff00ff00), |(lowest & 32'hf0f0f0f0),
                               |(lowest & 32'hcccccccc), |(lowest & 32'haaaaaaaa)};
    wire [23:0] event_row = word_row + {19'b0, lowest_index};

    always_ff @(posedge clk) begin
        mark1 <= marking && !clear;
        mark_place1 <= mark_place[PLACE-1:0];
        mark_bit1 <= 32'b1 << mark_step[4:0];
        over <= step == steps || (by_rows && aligned && row >= rows);
        if (out_ready) out_valid <= 0;
        case (state)
            IDLE: if (start) begin
                {step, row_done} <= 0;
                state <= FETCH;
            end
            FETCH: state <= COMPARE;
            COMPARE: begin
                due <= {{(23-INDEX){1'b0}}, index} != visits_end && visit_step == step;
                state <= NEXT;
            end
            NEXT:
            if (by_rows && !over && !row_done) begin
                channel <= 0;
                row_done <= 1;
                state <= CHANNEL;
            end else if (due) begin
                {place, source} <= {visit_place, visit_source};
                next_row <= -origin;
                words_left <= row_words;
                state <= PRIME;
            end else if (free) begin
                out_valid <= 1;
                out_kind <= over ? END : TICK;
                step <= step + 1;
                row_done <= 0;
                state <= over ? IDLE : COMPARE;
            end
            CHANNEL:
            if (next_channel) begin
                channel <= channel + 1;
                if (hit) begin
                    out_valid <= 1;
                    out_kind <= EVENT;
                    out_source <= row_source[SOURCE-1:0] + channel[SOURCE-1:0] - 1'b1;
                end
                if (channel == channels) state <= NEXT;
            end
            PRIME: begin
                place <= place + 1;
                bits <= 0;
                state <= SCAN;
            end
            default:
            if (bits != 0) begin
                if (free) begin
                    out_valid <= event_row < rows;  // before the first row it wraps, to a large number
                    out_kind <= EVENT;
                    out_source <= source + event_row[SOURCE-1:0];
                    bits <= bits & ~lowest;
                end
            end else if (words_left != 0) begin
                bits <= word;
                word_row <= next_row;
                next_row <= next_row + 32;
                place <= place + 1;
                words_left <= words_left - 1;
            end else begin
                index <= index + 1;
                state <= FETCH;
            end
        endcase
        if (clear) begin
            state <= IDLE;
            out_valid <= 0;
            index <= 0;
        end
    end

    wire unused = &{1'b0, load_address, load_data, mark_place, row_place, row_shift, row_source};
endmodule
