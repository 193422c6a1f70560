// The transpose buffer: a bit for every channel and step. Events set theirs while they arrive; the location phase reads
// them channel by channel, in the order of its visits: an event of step t is a spike of source `first + t` then.
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
    input  logic [23:0]               rows,       // steps of a recording that are kept
    input  logic [23:0]               row_words,  // words of a channel
    input  logic [23:0]               row_shift,  // of which a channel's place takes 2^row_shift
    input  logic [23:0]               visits,
    input  logic [23:0]               steps,
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

    // Reading. IDLE; FETCH: a visit is read; COMPARE: is its step now? VISIT_OR_TICK: so it is, or this step ends;
    // PRIME: its first word is read; SCAN: a spike for each bit of a word, while the next word waits.
    localparam logic [2:0] IDLE = 0, FETCH = 1, COMPARE = 2, VISIT_OR_TICK = 3, PRIME = 4, SCAN = 5;
    logic [2:0]        state;
    logic              due, over;
    logic [INDEX:0]    index;
    logic [23:0]       step, words_left;
    logic [PLACE-1:0]  place;
    logic [SOURCE-1:0] next_source, source;
    logic [31:0]       bits;
    logic [31:0]       word;
    logic [VISIT-1:0]  visit;
    wire [23:0]        visit_step = visit[23:0];
    wire [PLACE-1:0]   visit_place = visit[24+:PLACE];
    wire [SOURCE-1:0]  visit_source = visit[24+PLACE+:SOURCE];
    wire               free = !out_valid || out_ready;
    wire               next_word = state == SCAN && bits == 0 && words_left != 0;

    // Marking takes two cycles: read the word, write it with one bit more. A channel is marked once in a step, so a word
    // is not marked twice in a row.
    logic             mark1;
    logic [PLACE-1:0] mark_place1;
    logic [31:0]      mark_bit1;
    wire [23:0]       mark_place = ({8'b0, mark_channel} << row_shift[4:0]) | {5'b0, mark_step[23:5]};
    wire              marking = mark && mark_step < rows;

    memory #(.WIDTH(32), .DEPTH(BITMAP)) bitmap (
        .clk,
        .write        (mark1 || sweep),
        .write_address(sweep ? sweep_address : mark_place1),
        .write_data   (sweep ? 32'b0 : word | mark_bit1),
        .read         (marking || state == PRIME || next_word),
        .read_address (state == IDLE ? mark_place[PLACE-1:0] : place),
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

    always_ff @(posedge clk) begin
        mark1 <= marking && !clear;
        mark_place1 <= mark_place[PLACE-1:0];
        mark_bit1 <= 32'b1 << mark_step[4:0];
        if (out_ready) out_valid <= 0;
        case (state)
            IDLE: if (start) begin
                {index, step} <= 0;
                state <= FETCH;
            end
            FETCH: state <= COMPARE;
            COMPARE: begin
                due <= {{(23-INDEX){1'b0}}, index} != visits && visit_step == step;
                over <= step == steps;
                state <= VISIT_OR_TICK;
            end
            VISIT_OR_TICK:
            if (due) begin
                {place, next_source} <= {visit_place, visit_source};
                words_left <= row_words;
                state <= PRIME;
            end else if (free) begin
                out_valid <= 1;
                out_kind <= over ? END : TICK;
                step <= step + 1;
                state <= over ? IDLE : COMPARE;
            end
            PRIME: begin
                place <= place + 1;
                bits <= 0;
                state <= SCAN;
            end
            default:
            if (bits != 0) begin
                if (free) begin
                    out_valid <= 1;
                    out_kind <= EVENT;
                    out_source <= source + {{(SOURCE-5){1'b0}}, lowest_index};
                    bits <= bits & ~lowest;
                end
            end else if (words_left != 0) begin
                bits <= word;
                source <= next_source;
                next_source <= next_source + 32;
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
        end
    end

    wire unused = &{1'b0, load_address, load_data, mark_place, row_shift};
endmodule
