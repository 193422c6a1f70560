// Composes the frames for the host and decides which of them is sent next, a frame at a time: errors of the line first, then
// replies to commands, spikes, and the answer of a recording once its spikes are gone. A frame leaves byte by byte, type and
// sequence number first. Numbers have their highest byte first.
//
//     0x81 hello    version, program there, BUFFER (3 bytes), and the parameters of the core in their order (3 bytes each)
//     0x82 done     the frame of this sequence number was carried out
//     0x83 answer   error, class (2), cycles since the first word, seven counts (4 each), lost spikes (3)
//     0x84 spikes   what spike_report gives (3 bytes each)
//     0x85 error    the problem; its sequence number is that of the frame or, for problems 1 to 5, the one that must come next
module replies #(
    parameter integer BUFFER = 256,         // bytes of frames that frame_receiver holds, which a hello tells
    parameter integer SIZES = 11,           // how many parameters a hello lists, of 24 bits each
    parameter logic [24*SIZES-1:0] SIZE = 0  // the parameters, the first one highest
) (
    input  logic         clk,
    input  logic         reset,
    // From frame_receiver: an error of the line, and the sequence number that must come next.
    input  logic         error_valid,
    input  logic [7:0]   error,
    input  logic [7:0]   expected,
    // From commands: the reply to the frame of this number. It is taken with the last byte of the reply.
    input  logic         reply_valid,
    output logic         reply_ready,
    input  logic         reply_hello,
    input  logic [7:0]   reply_error,
    input  logic [7:0]   reply_number,
    input  logic         loaded,
    input  logic         spike_valid,
    output logic         spike_ready,
    input  logic [23:0]  spike,
    input  logic         spike_more,
    input  logic         answer_valid,
    output logic         answer_ready,
    input  logic [303:0] answer,
    output logic         frame_valid,
    input  logic         frame_ready,
    output logic [7:0]   frame_data,
    output logic         frame_last
);
    localparam logic [7:0] VERSION = 3;  // of the protocol; hw_model/rtl/board.py expects it
    localparam logic [7:0] HELLO = 8'h81, DONE = 8'h82, ANSWER = 8'h83, SPIKES = 8'h84, ERROR = 8'h85;
    // What is being sent: nothing, an error of the line, a reply to a command, spikes, the answer of a recording.
    localparam logic [2:0] IDLE = 0, LINE = 1, REPLY = 2, SPIKE = 3, FINAL = 4;
    localparam integer     LONGEST_BYTES = 40;  // of an answer: its type, its number (0) and 38 bytes; a hello has 40 as well
    localparam logic [3:0] MORE_SPIKES = 15;  // at most 16 spikes are in a frame, so that others may speak in between
    localparam logic [23:0] ROOM = 24'(BUFFER);

    logic [2:0] state;
    logic       pending;  // an error of the line, until it is answered
    logic [7:0] line_error;
    logic [5:0] index, last;  // of the byte that is sent, and of the last one of the frame
    logic [3:0] spikes_sent;

    // A register for the clock. It is a cycle old, but in time: a byte is taken in every other cycle at most, and the first two
    // bytes of a frame are its type and number.
    logic [23:0] spike_held;
    always_ff @(posedge clk) spike_held <= spike;

    // The bytes of the frame, the first one highest; those of a shorter frame lie at the top.
    logic [8*LONGEST_BYTES-1:0] body;
    always_comb begin
        body = 0;
        case (state)
            LINE: body[8*LONGEST_BYTES-1-:24] = {ERROR, expected, line_error};
            REPLY:
            if (reply_error != 0) body[8*LONGEST_BYTES-1-:24] = {ERROR, reply_number, reply_error};
            else if (reply_hello)
                body[8*LONGEST_BYTES-1-:56+24*SIZES] = {HELLO, reply_number, VERSION, 7'b0, loaded, ROOM, SIZE};
            else body[8*LONGEST_BYTES-1-:16] = {DONE, reply_number};
            SPIKE: body[8*LONGEST_BYTES-1-:40] = {SPIKES, 8'b0, spike_held};
            default: body[8*LONGEST_BYTES-1-:320] = {ANSWER, 8'b0, answer};
        endcase
    end

    wire [8:0] low = {6'd39 - index, 3'b0};
    wire       sent = frame_valid && frame_ready;
    // After the last byte of a spike (index 4) the next one goes into the same frame, from its first byte (index 2) on.
    wire       again = state == SPIKE && index == 4 && spike_more && spikes_sent != MORE_SPIKES;
    assign frame_valid = state != IDLE;
    assign frame_data = body[low+:8];
    assign frame_last = index == last && !again;
    assign reply_ready = state == REPLY && sent && frame_last;
    assign spike_ready = state == SPIKE && sent && index == 4;
    assign answer_ready = state == FINAL && sent && frame_last;

    always_ff @(posedge clk) begin
        if (error_valid && !pending) {pending, line_error} <= {1'b1, error};
        if (state == IDLE) begin
            {index, spikes_sent} <= 0;
            if (pending) {state, last} <= {LINE, 6'd2};
            else if (reply_valid)
                {state, last} <= {REPLY, reply_error != 0 ? 6'd2 : reply_hello ? 6'(6 + 3 * SIZES) : 6'd1};
            else if (spike_valid) {state, last} <= {SPIKE, 6'd4};
            else if (answer_valid) {state, last} <= {FINAL, 6'd39};
        end else if (sent) begin
            index <= again ? 2 : index + 1;
            if (again) spikes_sent <= spikes_sent + 1;
            if (frame_last) begin
                state <= IDLE;
                if (state == LINE) pending <= 0;
            end
        end
        if (reset) begin
            state <= IDLE;
            pending <= 0;
        end
    end
endmodule
