// A reset that ends in step with the clock, some cycles after the device is configured or its button is let go.
module reset_sync (
    input  logic clk,
    input  logic button,  // high: reset; may come at any time
    output logic reset
);
    logic [1:0] pressed = 0;
    logic [5:0] count = 0;  // 0 after configuration, too; bit 5: 32 cycles have passed
    assign reset = !count[5];
    always_ff @(posedge clk) begin
        pressed <= {pressed[0], button};
        if (pressed[1]) count <= 0;
        else if (reset) count <= count + 1;
    end
endmodule
