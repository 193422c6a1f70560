// A CRC-16 after one more byte: polynomial 0x1021, highest bit first, 0xFFFF before the first byte. After a message and its
// own CRC, highest byte first, it is 0.
module crc16 (
    input  logic [15:0] crc,
    input  logic [7:0]  data,
    output logic [15:0] next
);
    wire [7:0] top = crc[15:8] ^ data;
    wire [7:0] mixed = top ^ {4'b0, top[7:4]};
    assign next = {crc[7:0], 8'b0} ^ {mixed[3:0], 12'b0} ^ {3'b0, mixed, 5'b0} ^ {8'b0, mixed};
endmodule
