// A queue whose newest words can be dropped until they are committed.
module held_queue #(
    parameter integer WIDTH = 9,
    parameter integer DEPTH = 256  // a power of two
) (
    input  logic                   clk,
    input  logic                   clear,
    input  logic                   push,
    input  logic [WIDTH-1:0]       pushed,
    input  logic                   commit,  // all that was pushed, this cycle's word included
    input  logic                   drop,    // all that is not committed
    output logic                   full,
    output logic                   head_valid,
    output logic [WIDTH-1:0]       head,
    input  logic                   pop,
    output logic [$clog2(DEPTH):0] level    // committed words
);
    localparam integer PLACE = $clog2(DEPTH);

    logic [PLACE:0] begin_at, committed, end_at;  // one bit more than a place, which tells full from empty
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
