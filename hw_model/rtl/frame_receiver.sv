// Turns the bytes of a line into whole and correct frames: type, sequence number, payload.
//
// On the line a frame stands between flags (0x7E) and ends in its CRC-16. Flags and escapes (0x7D) within it are sent as an
// escape and the byte with bit 5 inverted, as in RFC 1662. A frame is passed on only once its CRC and its sequence number are
// right, so a frame that is damaged, cut off or repeated has no effect. It is answered once, with `error`, and the next flag
// starts a frame anew. Sequence numbers count frames; a hello may have any number, and the next frame has the one after it.
module frame_receiver #(
    parameter integer BUFFER = 256  // bytes of frames that wait, types and numbers included; a power of two
) (
    input  logic       clk,
    input  logic       reset,
    input  logic       byte_valid,
    input  logic [7:0] byte_data,
    input  logic       byte_broken,     // a byte had no stop bit
    // Bytes of correct frames: type, sequence number, payload.
    output logic       frame_valid,
    input  logic       frame_ready,
    output logic [7:0] frame_data,
    output logic       frame_last,
    // An error of a frame, for one cycle: problems 1 to 5, named below.
    output logic       error_valid,
    output logic [7:0] error,
    output logic [7:0] expected     // the sequence number that must come next
);
    localparam logic [7:0] FLAG = 8'h7e, ESCAPE = 8'h7d, HELLO = 1;
    // A byte without its stop bit; a wrong CRC; fewer than four bytes; more than there is room for; a wrong sequence number.
    localparam logic [7:0] LINE = 1, CHECKSUM = 2, SHORT = 3, OVERRUN = 4, SEQUENCE = 5;

    logic        escaped;
    logic        spoiled;            // the frame's error is answered; its rest is skipped, up to the next flag
    logic [2:0]  seen;               // bytes of this frame so far, CRC included; 4 for four or more
    logic [7:0]  kind, number;       // its type and its sequence number
    // The last three bytes, the newest in held1. The two newest are the CRC once the frame is over and must not be stored, so
    // a byte is stored three bytes late, and the last byte of the payload with the flag.
    logic [7:0]  held1, held2, held3;
    logic [15:0] crc;
    wire  [15:0] next_crc;
    wire  [7:0]  value = escaped ? byte_data ^ 8'h20 : byte_data;
    wire         flag = byte_valid && byte_data == FLAG;
    wire         plain = byte_valid && !flag && (escaped || byte_data != ESCAPE) && !spoiled;
    wire         full;

    crc16 check (.crc, .data(value), .next(next_crc));

    logic [7:0] problem;  // what is wrong with the frame that this flag ends
    always_comb begin
        problem = 0;
        if (escaped || (seen == 4 && crc != 0)) problem = CHECKSUM;
        else if (seen < 4) problem = SHORT;
        else if (full) problem = OVERRUN;
        else if (kind != HELLO && number != expected) problem = SEQUENCE;
    end
    wire over = flag && !spoiled && (seen != 0 || escaped);  // flags that follow each other have no frame between them
    wire right = over && problem == 0;
    wire keep = plain && seen >= 3 && !full;

    held_queue #(.WIDTH(9), .DEPTH(BUFFER)) frames (
        // The ninth bit says that the byte is the last one of its frame.
        .clk, .clear(reset), .push(keep || right), .pushed({right, held3}), .commit(right), .drop(flag && !right), .full,
        .head_valid(frame_valid), .head({frame_last, frame_data}), .pop(frame_valid && frame_ready),
        /* verilator lint_off PINCONNECTEMPTY */
        .level()
        /* verilator lint_on PINCONNECTEMPTY */
    );

    always_ff @(posedge clk) begin
        error_valid <= 0;
        if (byte_valid) escaped <= !flag && !escaped && byte_data == ESCAPE;
        if (plain) begin
            {held3, held2, held1} <= {held2, held1, value};
            crc <= next_crc;
            if (seen != 4) seen <= seen + 1;
            if (seen == 0) kind <= value;
            if (seen == 1) number <= value;
        end
        if (plain && seen >= 3 && full) {error_valid, error, spoiled} <= {1'b1, OVERRUN, 1'b1};
        if (byte_broken && !spoiled) {error_valid, error, spoiled} <= {1'b1, LINE, 1'b1};
        if (over && !right) {error_valid, error} <= {1'b1, problem};
        if (right) expected <= number + 1;
        if (flag || reset) begin
            {seen, spoiled} <= 0;
            crc <= 16'hffff;
        end
        if (reset) {escaped, expected, error_valid} <= 0;
    end
endmodule
