// A first-in first-out queue whose newest words are held back until they are committed, and can be dropped until then. `head` is
// the oldest committed word while `head_valid` is high; the next one shows in the cycle after a pop, a pushed word two cycles
// after it was pushed and committed at the earliest. The user must not push while the queue is full.
module held_queue #(
    parameter integer WIDTH = 9,   // bits of a word
    parameter integer DEPTH = 256  // words; a power of two
) (
    input  logic                   clk,
    input  logic                   clear,
    input  logic                   push,
    input  logic [WIDTH-1:0]       pushed,
    input  logic                   commit,  // commits all that was pushed, the word of this cycle included
    input  logic                   drop,    // drops all that is not committed
    output logic                   full,
    output logic                   head_valid,
    output logic [WIDTH-1:0]       head,
    input  logic                   pop,
    output logic [$clog2(DEPTH):0] level    // committed words
);
    localparam integer PLACE = $clog2(DEPTH);

    // Oldest word, first word that is not committed, next free place. One bit more than a place tells full from empty.
    logic [PLACE:0] begin_at, committed, end_at;
    wire  [PLACE:0] next_begin = begin_at + {{PLACE{1'b0}}, pop};
    wire  [PLACE:0] next_end = end_at + {{PLACE{1'b0}}, push};
    assign full = end_at == {!begin_at[PLACE], begin_at[PLACE-1:0]};
    assign level = committed - begin_at;

    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH)) places (
        .clk,
        .write        (push),
        .write_address(end_at[PLACE-1:0]),
        .write_data   (pushed),
        .read         (1'b1),
        .read_address (next_begin[PLACE-1:0]),
        .read_data    (head)
    );

    always_ff @(posedge clk) begin
        begin_at <= next_begin;
        head_valid <= next_begin != committed;
        end_at <= drop ? committed : next_end;
        if (commit) committed <= next_end;
        if (clear) {begin_at, committed, end_at, head_valid} <= 0;
    end
endmodule
