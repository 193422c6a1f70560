// Turns frames into the bytes of a line: a flag, then the frame and its CRC-16 with escapes, then a flag; frame_receiver.sv
// says how frames look on the line. A byte of the frame is taken once it was sent, so it must stay until then.
module frame_sender (
    input  logic       clk,
    input  logic       reset,
    input  logic       frame_valid,
    output logic       frame_ready,
    input  logic [7:0] frame_data,
    input  logic       frame_last,
    output logic       byte_valid,
    input  logic       byte_ready,
    output logic [7:0] byte_data
);
    localparam logic [7:0] FLAG = 8'h7e, ESCAPE = 8'h7d;
    // IDLE: the first flag waits for a frame; BODY: its bytes; CRC_HIGH, CRC_LOW: those of the CRC; CLOSE: the last flag.
    localparam logic [2:0] IDLE = 0, BODY = 1, CRC_HIGH = 2, CRC_LOW = 3, CLOSE = 4;

    logic [2:0]  state;
    logic        escaped;  // the escape of this byte was sent
    logic [15:0] crc;
    wire  [15:0] next_crc;
    wire  [7:0]  value = state == BODY ? frame_data : state == CRC_HIGH ? crc[15:8] : crc[7:0];
    wire         special = value == FLAG || value == ESCAPE;
    wire         flag = state == IDLE || state == CLOSE;
    wire         sent = byte_valid && byte_ready;
    wire         value_sent = sent && !flag && (!special || escaped);

    crc16 check (.crc, .data(frame_data), .next(next_crc));

    assign byte_valid = frame_valid || (state != IDLE && state != BODY);
    assign byte_data = flag ? FLAG : !special ? value : escaped ? value ^ 8'h20 : ESCAPE;
    assign frame_ready = state == BODY && value_sent;

    always_ff @(posedge clk) begin
        if (sent) escaped <= !flag && special && !escaped;
        case (state)
            IDLE: begin
                crc <= 16'hffff;
                if (sent) state <= BODY;
            end
            BODY: if (value_sent) begin
                crc <= next_crc;
                if (frame_last) state <= CRC_HIGH;
            end
            CRC_HIGH: if (value_sent) state <= CRC_LOW;
            CRC_LOW: if (value_sent) state <= CLOSE;
            default: if (sent) state <= IDLE;
        endcase
        if (reset) begin
            state <= IDLE;
            escaped <= 0;
        end
    end
endmodule
